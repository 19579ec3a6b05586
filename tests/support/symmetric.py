"""One observation as a symmetry makes it, in NumPy: what views of batches are compared with."""

from usbench.envs.observation.senses import IMAGE, SENSES, parts, whole


def viewed(symmetries, number, observation):
    """Return what frames (height, width, n) and senses (n * size,) become by symmetry `number`."""
    known = dict(parts(observation))
    if symmetries.mirrored[number]:
        known[IMAGE] = known[IMAGE][:, ::-1].copy()
    if SENSES in known:
        each = known[SENSES].reshape(-1, symmetries.sources.shape[1])
        known[SENSES] = (each[:, symmetries.sources[number]] * symmetries.signs[number]).reshape(-1)
    return whole(known)
