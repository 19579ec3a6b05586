"""Results of several sources together."""

import pandas as pd
import pytest
from made_tables import made, trial

from usbench.checks import ConfigurationError
from usbench.results import sources, studies, tables


def test_of_a_trial_in_several_sources_one_counts_whole(tmp_path):
    versions = [made(trial(status="running")), made(trial(score=0.4)), made(trial(score=0.9))]
    places = []
    for number, known in enumerate(versions):
        tables.write(known, tmp_path / str(number))
        places.append(tmp_path / str(number))
    for chosen, wanted in (((0, 1), 1), ((1, 0), 1), ((1, 2), 2), ((2, 1), 1)):
        found = sources.gather([places[number] for number in chosen])
        alone = tables.read(places[wanted])
        pd.testing.assert_frame_equal(found.trials, alone.trials)
        pd.testing.assert_frame_equal(found.curves, alone.curves)


def test_a_table_of_studies_without_a_column_is_refused(tmp_path):
    (tmp_path / studies.TABLE).write_text("study,task\none,pp\n")
    with pytest.raises(ValueError, match=r"studies.csv is damaged: it has no column 'noise'"):
        studies.read(tmp_path)


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="there is no folder"):
        sources.gather([tmp_path / "nowhere"])


def test_two_trials_of_one_name_are_refused(tmp_path):
    for number, one in enumerate((trial("vpg", trial="x"), trial("ppo", trial="x"))):
        tables.write(made(one), tmp_path / str(number))
    with pytest.raises(ConfigurationError, match="x is the name of two trials with different settings"):
        sources.gather([tmp_path / "0", tmp_path / "1"])


def test_no_source_is_refused():
    with pytest.raises(ConfigurationError, match="name a folder of trials"):
        sources.gather([])
