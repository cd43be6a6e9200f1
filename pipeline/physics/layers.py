"""placeholder by the lead; the edges engineer fills this in: mixed_transmittance(alpha, front, behind, t_front, t_behind)."""


def mixed_transmittance(alpha, front, behind, t_front, t_behind):
    raise NotImplementedError
