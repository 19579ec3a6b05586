"""A custom anatomy: from the words of a command to the phantom, into the records of a trial, and back."""

from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

from usbench.checks import unknown
from usbench.coordinates import POSE
from usbench.envs.anatomy import Anatomy, Echogenicity, Placement, Recording
from usbench.envs.pose import Pose
from usbench.records import VOLUME, ConfigurationError

KINDS: Mapping[str, type[Anatomy]] = MappingProxyType({"simulated": Echogenicity, "recorded": Recording})
TARGET = {f"target_{name}": name for name in POSE}
PLACEMENT = tuple(field.name for field in fields(Placement))


def read(path: Path, settings: Mapping[str, Any], *, looking: bool = False) -> Anatomy:
    """Return the anatomy in a file.

    Args:
        path: NIfTI, MHA or NRRD.
        settings: As text: "frames" (one of KINDS), the target ("target_x_mm", ..), the fields of `Placement`
            and, simulated, of `Echogenicity`.
        looking: Whether there need be no target, for somebody who looks around.

    Raises:
        ConfigurationError: If anything is not allowed; one sentence says what is.
    """
    given: dict[str, Any] = dict(settings)
    try:
        if not path.exists():
            raise FileNotFoundError(f"there is no volume {str(path)!r}.")
        kind = given.pop("frames", "simulated")
        if kind not in KINDS:
            raise unknown("frames", kind, KINDS)
        own = _own(KINDS[kind])
        for name in given:
            if name not in (*TARGET, *PLACEMENT, *own):
                raise _foreign(name, kind)
        target = {TARGET[name]: value for name, value in given.items() if name in TARGET}
        if not target and not looking:
            raise ValueError(
                "a custom anatomy needs the pose that shows best what is looked for: target_x_mm and "
                "target_angle_deg, or target_focal_depth_mm."
            )
        return KINDS[kind].read(
            path,
            target=_target(target) if target else None,
            placement=Placement(**{name: value for name, value in given.items() if name in PLACEMENT}),
            **{name: value for name, value in given.items() if name in own},
        )
    except (ImportError, OSError, TypeError, ValueError) as error:
        raise ConfigurationError(str(error)) from error


def plain(anatomy: Anatomy) -> dict[str, Any]:
    """Return the entries of an environment's configuration: the phantom, and where its file is.

    Raises:
        ConfigurationError: If it is of a class of its own, which a record could not make again.
    """
    kinds = {cls: name for name, cls in KINDS.items()}
    if type(anatomy) not in kinds:
        allowed = " and ".join(cls.__name__ for cls in kinds)
        raise ConfigurationError(
            f"a phantom of the class {type(anatomy).__name__} cannot be recorded: allowed are {allowed}."
        )
    values = asdict(anatomy)
    return {VOLUME: values.pop("path"), "phantom": {"frames": kinds[type(anatomy)], **values}}


def recorded(environment: Mapping[str, Any]) -> Anatomy | None:
    """Return the anatomy in the configuration that a trial has recorded; None if it has the task's phantom.

    Its file is read when a frame is made that is not kept.

    Raises:
        ConfigurationError: If the configuration cannot be one.
    """
    if VOLUME not in environment:
        return None
    try:
        values = dict(environment["phantom"])
        target, placement = Pose(**values.pop("target")), Placement(**values.pop("placement"))
        cls, path = KINDS[values.pop("frames")], str(environment[VOLUME])
        return cls(path=path, target=target, placement=placement, **values)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ConfigurationError(f"the trial's phantom is not one that can be recorded ({error}).") from error


def _target(values: Mapping[str, Any]) -> Pose:
    try:
        return Pose(**values)
    except (TypeError, ValueError) as error:
        # Begins with the coordinate's name.
        raise ValueError(f"target_{error}") from error


def _foreign(name: str, kind: str) -> ValueError:
    """Return the error for a setting that `kind` does not have."""
    for other, cls in KINDS.items():
        if name in _own(cls):
            return ValueError(f"{name} is for frames={other} alone, not for frames={kind}.")
    return unknown("setting of a phantom", name, ("frames", *TARGET, *PLACEMENT, *_own(KINDS[kind])))


def _own(cls: type[Anatomy]) -> list[str]:
    common = [field.name for field in fields(Anatomy)]
    return [field.name for field in fields(cls) if field.name not in common]
