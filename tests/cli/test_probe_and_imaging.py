"""`--probe`, `--imaging` and `usbench defaults`: read, refused, and part of the configuration."""

import tomllib
from dataclasses import asdict

import pytest

from usbench import cli, records, setting_files
from usbench.envs.bmode import Imaging
from usbench.envs.probe import LinearArray
from usbench.setting import Setting
from usbench.trials.configuration import resolve

RUN = ["run", "--algo", "dqn", "--task", "pp", "--steps", "10", "--quiet"]


@pytest.mark.parametrize(("kind", "part"), [("probe", LinearArray()), ("imaging", Imaging())])
def test_defaults_are_a_file_of_every_field_explained(kind, part, capsys, tmp_path):
    assert cli.main(["defaults", kind]) == 0
    text = capsys.readouterr().out
    assert tomllib.loads(text) == asdict(part)
    assert text.count("# ") == len(asdict(part))
    (tmp_path / "file.toml").write_text(text)
    assert getattr(setting_files, f"read_{kind}")(tmp_path / "file.toml") == part


def test_defaults_of_something_else_are_refused(capsys):
    assert cli.main(["defaults", "phantom"]) == 2
    assert "allowed are 'probe', 'imaging'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "text", "message"),
    [
        ("--probe", "n_elemets = 3", "did you mean 'n_elements'"),
        ("--probe", "kerf = -1.0", "kerf must be a non-negative number, not -1.0"),
        ("--probe", "n_lines = 2.5", "n_lines must be a whole number from 1, not 2.5"),
        ("--probe", "element_width = 'wide'", "element_width must be a positive number, not 'wide'"),
        ("--probe", "kerf = ", "Invalid value"),
        ("--imaging", "height_px = 0", "height_px must be a whole number from 1, not 0"),
        ("--imaging", "pixel_size = nan", "pixel_size must be a positive number, not nan"),
        ("--imaging", "colour = 1", "unknown field of the imaging file 'colour'"),
    ],
)
def test_files_that_cannot_be_used_are_refused_in_one_sentence(option, text, message, capsys, tmp_path):
    path = tmp_path / "part.toml"
    path.write_text(text)
    assert cli.main([*RUN, option, str(path)]) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1


def test_a_missing_file_is_refused(capsys, tmp_path):
    assert cli.main([*RUN, "--probe", str(tmp_path / "none.toml")]) == 2
    assert "cannot be read (No such file or directory)" in capsys.readouterr().err


def test_they_are_part_of_the_configuration_and_found_again():
    probe, imaging = LinearArray(n_lines=96), Imaging(height_px=128, width_px=128)
    plain, own = resolve("dqn", "pp"), resolve("dqn", "pp", probe=probe, imaging=imaging)
    assert own.hash != plain.hash and own.environment["probe"]["n_lines"] == 96
    assert Setting.recorded(own) == Setting(task="pp", probe=probe, imaging=imaging)
    assert resolve("dqn", "pp", probe=LinearArray(), imaging=Imaging()) == plain


@pytest.mark.slow
@pytest.mark.parametrize("size", [64, 128])
def test_ten_steps_with_other_frames_train(size, tmp_path):
    (tmp_path / "imaging.toml").write_text(f"height_px = {size}\nwidth_px = {size}\n")
    argv = [*RUN, "--imaging", str(tmp_path / "imaging.toml"), "--out", str(tmp_path / "runs")]
    assert cli.main(argv) == 0
    (trial,) = records.load_trials(tmp_path / "runs")
    assert trial.status == "finished" and trial.config.environment["imaging"]["width_px"] == size
