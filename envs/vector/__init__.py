"""Many environments in step: the frames of all of them in one call, with the bits of one by one."""
