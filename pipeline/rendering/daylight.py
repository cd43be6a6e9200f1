"""Sun and sky after Liu et al. 2009 and Xing et al. 2012, from patches of the photograph."""


def daylight(build, scene, settings, names):
    raise NotImplementedError
