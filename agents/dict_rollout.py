"""A rollout of observations that are dictionaries, for algorithms that take a part of a batch."""

from typing import Any

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.type_aliases import DictRolloutBufferSamples
from stable_baselines3.common.vec_env import VecNormalize

from usbench.agents.on_policy import ValuesAtEndDictBuffer


class SliceableObservations(dict[str, Any]):
    """A batch of observations: by a name one of their parts, by a slice a part of the batch."""

    def __getitem__(self, key: Any) -> Any:
        """The part called `key`, or the observations that the slice `key` leaves."""
        if isinstance(key, slice):
            return SliceableObservations({name: values[key] for name, values in self.items()})
        return super().__getitem__(key)


class SliceableRolloutBuffer(ValuesAtEndDictBuffer):
    """SB3's rollout, whose batches can be cut as TRPO does to leave out steps (`sub_sampling_factor`)."""

    # Stable-Baselines3 too returns another class here than in its other rollouts.
    def _get_samples(  # type: ignore[override]
        self, batch_inds: npt.NDArray[np.intp], env: VecNormalize | None = None
    ) -> DictRolloutBufferSamples:
        samples = super()._get_samples(batch_inds, env)
        return samples._replace(observations=SliceableObservations(samples.observations))
