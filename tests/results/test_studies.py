"""The table of studies: whole after every writing, whatever studies are called."""

import pandas as pd
import pytest

from usbench.checks import ConfigurationError
from usbench.results import studies


def of(study, score=0.5):
    """Return the rows of a study."""
    row = {"task": "pp", "noise": 0.0, "agent": "best:pp", "played": 4, "plays": 4, "episodes": 2}
    numbers = dict.fromkeys(studies.NUMBERS, score)
    return pd.DataFrame(
        [{"study": study, "player": player, **row, **numbers} for player in studies.PLAYERS],
        columns=list(studies.COLUMNS),
    )


def test_added_studies_stand_beside_those_that_are_there(tmp_path):
    studies.write(of("anna"), tmp_path)
    studies.write(studies.add(studies.read(tmp_path), of("bob")), tmp_path)
    with pytest.raises(ConfigurationError, match="another study 'bob'"):
        studies.add(studies.read(tmp_path), of("bob", 0.6))
    gone_on = of("anna", 0.7).assign(played=5)
    studies.write(studies.add(studies.read(tmp_path), gone_on), tmp_path)
    studies.write(studies.add(studies.read(tmp_path), gone_on), tmp_path)  # the same again
    known = studies.read(tmp_path)
    assert dict(known.groupby("study")["score"].max()) == {"anna": 0.7, "bob": 0.5}
    assert len(known) == 2 * len(studies.PLAYERS)


@pytest.mark.parametrize(
    ("what", "value"),
    [("task", "fp"), ("noise", 0.5), ("agent", "oracle"), ("played", 2), ("score", 0.7)],
)
def test_another_study_of_the_same_name_is_refused_unless_it_is_to_replace_it(what, value):
    other = of("anna").assign(**{what: value})
    with pytest.raises(ConfigurationError, match=r"another study 'anna' \(pp, noise 0, .* 4 of 4 played"):
        studies.add(of("anna"), other)
    pd.testing.assert_frame_equal(studies.add(of("anna"), other, replace=True), other)


def test_without_a_study_nothing_of_others_stays(tmp_path):
    studies.write(of("anna"), tmp_path)
    studies.write(of("anna")[:0], tmp_path)
    assert studies.read(tmp_path).empty


def test_names_are_names_whatever_they_look_like(tmp_path):
    studies.write(pd.concat([of("NA"), of("007")]), tmp_path)
    assert set(studies.read(tmp_path)["study"]) == {"NA", "007"}
