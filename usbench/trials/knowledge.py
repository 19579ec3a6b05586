"""What a task knows of itself, for the algorithms that are told: symmetries, a teacher, a scene model."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, TypeVar

from usbench.checks import as_configuration_error
from usbench.envs.ceilings import scene_model as models
from usbench.envs.ceilings import teacher as teachers
from usbench.envs.ceilings.scene_model import SceneModel
from usbench.envs.ceilings.teacher import Teacher
from usbench.envs.observation.symmetries import Symmetries
from usbench.envs.observation.symmetries import symmetries as of_senses
from usbench.setting import Setting

T = TypeVar("T")


def symmetries(setting: Setting) -> Symmetries:
    """Return what an observation and an action of the task become by its exact symmetries.

    Where the tissue is the same in all episodes, its speckle tells poses apart that would be alike
    otherwise: there is none then but that which changes nothing.
    """
    plain = setting.plain_env()
    return of_senses(plain.senses, plain.phantoms if setting.row.phantoms else None)


def teacher(setting: Setting) -> Teacher:
    """Return who knows the costs of actions by what an agent with these senses can know at best.

    Raises:
        ConfigurationError: If the task draws no phantoms, or its beliefs cannot be listed.
    """
    return _of_drawn_phantoms(teachers.teacher, "a teacher", setting)


def scene_model(setting: Setting) -> SceneModel:
    """Return what a classical agent knows of the task.

    Raises:
        ConfigurationError: If the task draws no phantoms, moves the focus, or does not tell the pose.
    """
    return _of_drawn_phantoms(models.scene_model, "a classical agent", setting)


# What an algorithm may need, by the name in its row.
NEEDS: Mapping[str, Callable[[Setting], Any]] = MappingProxyType(
    {"teacher": teacher, "scene_model": scene_model}
)


def _of_drawn_phantoms(made: Callable[..., T], what: str, setting: Setting) -> T:
    """Return what is made for the task, its phantoms, senses and noise."""
    with as_configuration_error():
        setting.check_drawn(what)
        plain = setting.plain_env()
        return made(plain.task, plain.distribution, plain.senses.names, setting.noise)
