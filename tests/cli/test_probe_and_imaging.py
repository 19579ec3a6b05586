"""`--probe`, `--imaging` and `usbench defaults`: read, refused, and part of the configuration."""

import json
import tomllib
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import usbench
from usbench import cli, records
from usbench.envs.bmode import Imaging
from usbench.envs.probe import LinearArray
from usbench.setting import Setting
from usbench.setting_parts import toml_files
from usbench.trials.configuration import resolve

RUN = ["run", "--algo", "dqn", "--task", "pp", "--steps", "10", "--quiet"]


@pytest.mark.parametrize(("kind", "part"), [("probe", LinearArray()), ("imaging", Imaging())])
def test_defaults_are_a_file_of_every_field_explained(kind, part, capsys, tmp_path):
    assert cli.main(["defaults", kind]) == 0
    text = capsys.readouterr().out
    values = {name: value for name, value in asdict(part).items() if value is not None}
    assert tomllib.loads(text) == values
    assert text.count("# ") == len(asdict(part)) + text.count(" =\n")
    assert all(f"# {name} =\n" in text for name in asdict(part).keys() - values.keys())
    (tmp_path / "file.toml").write_text(text)
    assert getattr(toml_files, f"read_{kind}")(tmp_path / "file.toml") == part


def test_defaults_of_something_else_are_refused(capsys):
    assert cli.main(["defaults", "phantom"]) == 2
    assert "allowed are 'probe', 'imaging', 'l11-4v'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "text", "message"),
    [
        ("--probe", "n_elemets = 3", "did you mean 'n_elements'"),
        ("--probe", "kerf = -1.0", "kerf must be a non-negative number, not -1.0"),
        ("--probe", "n_lines = 2.5", "n_lines must be a whole number from 1, not 2.5"),
        ("--probe", "element_width = 'wide'", "element_width must be a positive number, not 'wide'"),
        ("--probe", "kerf = ", "Invalid value"),
        ("--imaging", "height_px = 0", "height_px must be a whole number in [1, 500], not 0"),
        ("--imaging", "pixel_size = nan", "pixel_size must be a positive number, not nan"),
        ("--imaging", "noise_db = nan", "noise_db must be a non-negative number, not nan"),
        ("--imaging", "noise_db = 'loud'", "noise_db must be a non-negative number, not 'loud'"),
        ("--imaging", "tgc_db_per_cm = [[0.05, 9], [0.01, 1]]", "must increase, not go from 0.05 to 0.01 m"),
        ("--imaging", "colour = 1", "unknown field of the imaging file 'colour'"),
    ],
)
def test_files_that_cannot_be_used_are_refused_in_one_sentence(option, text, message, capsys, tmp_path):
    path = tmp_path / "part.toml"
    path.write_text(text)
    assert cli.main([*RUN, option, str(path)]) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_files_that_windows_writes_are_read(encoding, tmp_path):
    path = tmp_path / "probe.toml"
    path.write_text("n_lines = 96\n", encoding=encoding)
    assert toml_files.read_probe(path) == LinearArray(n_lines=96)


def test_a_file_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "probe.toml"
    path.write_bytes(b"n_lines = \xe9\n")
    with pytest.raises(records.ConfigurationError, match=r"cannot be used: it must be text in UTF-8\.$"):
        toml_files.read_probe(path)


def test_a_missing_file_is_refused(capsys, tmp_path):
    assert cli.main([*RUN, "--probe", str(tmp_path / "none.toml")]) == 2
    assert "cannot be read (No such file or directory)" in capsys.readouterr().err


def test_they_are_part_of_the_configuration_and_found_again():
    probe = LinearArray(n_lines=96)
    imaging = Imaging(height_px=128, noise_db=60, tgc_db_per_cm=[(0, 0), (0.05, 20)])
    plain, own = resolve("dqn", "pp"), resolve("dqn", "pp", probe=probe, imaging=imaging)
    assert own.hash != plain.hash and own.environment["probe"]["n_lines"] == 96
    assert Setting.recorded(own) == Setting(task="pp", probe=probe, imaging=imaging)
    read_back = records.TrialConfig(**json.loads(json.dumps(asdict(own))))
    assert read_back == own and read_back.hash == own.hash
    assert resolve("dqn", "pp", probe=LinearArray(), imaging=Imaging()) == plain


# Limits of the two-way band (-6 dB) that each file names for its probe.
BANDS = {"l7-4": (4e6, 7e6), "l11-4v": (3.85e6, 10.63e6), "l12-5": (5e6, 11e6)}


@pytest.mark.parametrize("name", toml_files.presets())
def test_a_preset_is_a_probe_with_sources_and_full_apertures(name, capsys):
    probe = usbench.read_probe(name)
    assert probe == usbench.read_probe(name.upper()) == toml_files.read_probe(Path(name))
    # No line lies beyond the last full aperture.
    assert probe.line_positions == pytest.approx(probe.aperture_centers(probe.line_positions), abs=1e-9)
    assert cli.main(["defaults", name]) == 0
    text = capsys.readouterr().out
    assert LinearArray(**tomllib.loads(text)) == probe and "computeTrans.m" in text


@pytest.mark.parametrize("name", toml_files.presets())
def test_a_preset_has_the_band_of_its_transducer(name):
    probe = usbench.read_probe(name)
    # Without the excitation, which the manufacturer's band does not contain.
    duration = probe.impulse_response_cycles / probe.center_frequency
    time = np.arange(0, duration, 1 / probe.sampling_frequency)
    response = np.sin(2 * np.pi * probe.center_frequency * time) * np.sin(np.pi * time / duration) ** 2
    frequencies = np.linspace(0.2, 2.0, 1801) * probe.center_frequency
    two_way = np.abs(np.exp(-2j * np.pi * np.outer(frequencies, time)) @ response) ** 2
    band = frequencies[two_way >= two_way.max() / 2]
    assert (band[0], band[-1]) == pytest.approx(BANDS[name], rel=0.08)


def test_presets_are_listed_and_a_close_name_is_told(capsys):
    assert cli.main(["list"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in toml_files.presets())
    assert cli.main([*RUN, "--probe", "l7-5"]) == 2
    assert "did you mean 'l7-4'?" in capsys.readouterr().err


def test_noise_and_gain_are_recorded_only_where_they_are_on():
    assert not {"noise_db", "tgc_db_per_cm"} & set(resolve("dqn", "pp").environment["imaging"])
    imaging = resolve("dqn", "pp", imaging=Imaging(noise_db=55, tgc_db_per_cm=3)).environment["imaging"]
    assert (imaging["noise_db"], imaging["tgc_db_per_cm"]) == (55.0, 3.0)


def test_a_file_with_noise_and_a_curve_of_gain_is_read(tmp_path):
    path = tmp_path / "imaging.toml"
    path.write_text("noise_db = 60\ntgc_db_per_cm = [[0.0, 0], [0.05, 20]]\n")
    curve = ((0.0, 0.0), (0.05, 20.0))
    assert toml_files.read_imaging(path) == Imaging(noise_db=60.0, tgc_db_per_cm=curve)


@pytest.mark.slow
@pytest.mark.parametrize("size", [64, 128])
def test_ten_steps_with_other_frames_train(size, tmp_path):
    (tmp_path / "imaging.toml").write_text(f"height_px = {size}\nwidth_px = {size}\n")
    argv = [*RUN, "--imaging", str(tmp_path / "imaging.toml"), "--out", str(tmp_path / "runs")]
    assert cli.main(argv) == 0
    (trial,) = records.load_trials(tmp_path / "runs")
    assert trial.status == "finished" and trial.config.environment["imaging"]["width_px"] == size
