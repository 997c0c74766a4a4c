"""Pre-sliding, stick-slip and sliding of the skin over a texture; one degree of freedom, s along the motion.

State: deflection s of the skin (mm), whether it slips, threshold mu*; X = int (v - ds/dt) dt: slip distance.

    stick  ds/dt = v  until  k_t s > mu* F rho(X)
    slip   ds/dt = (s_k - s) / 2 ms,   s_k = (mu_k - (mu_s - mu_k) e^(-v / v_s) / 2) rho(X) F / k_t
           until s is within 15 % of the drop; then stick with
           mu* = mu_k + (mu_s - mu_k) e^(-v / v_s) e^(j n) + 0.004,   n ~ N(0, 1) of this slip

With incipient slip the rim of the contact slips before its middle does (Cattaneo, Mindlin). The share
(c / a)^2 = (1 - phi)^(2/3) of the contact still sticks, phi being how far s has come from where the stick
began, s_0, to where it ends. Only that share carries the skin along; the rest slides over the texture:

    stick  ds/dt = v (1 - phi)^(2/3),   phi = (s - s_0) / (mu* F rho(X) / k_t - s_0)
           so (1 - phi)^(1/3) falls linearly with the way, and the stick ends after three times the deflection

rho(X) = 1 + eta n(X) is the friction roughness. Both phases are exact within a step (v, F and X held),
their ends are located within it: a step's length moves no slip. The first stick is the pre-sliding burst,
mu* = mu_s.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dse.base.native.compiled import compiled

RELAXATION_S = 0.002
LEAVES_AT = 0.15
FLOOR = 0.004
_MOST_CHANGES = 64


class Friction(NamedTuple):
    """Friction of one trial; the trial's factor is in mu_static and mu_kinetic."""

    mu_static: float
    mu_kinetic: float
    stribeck_mm_s: float
    jitter: float
    roughness: float
    stiffness_n_mm: float
    incipient_slip: bool = False


@compiled()
def travel(friction, v, force, step, line, line_step, normals):  # type: ignore[no-untyped-def]
    """Return deflection s and slip distance X in mm at the n + 1 ends of n steps, both (n + 1,) from 0.

    v, force: (n,) speed, mm/s, never negative, and normal force, N, during each step of so many seconds.
    line: friction roughness along X, unit variance, periodic. normals: (m,) standard normals; slip number i
    uses entry i mod m.
    """
    mu_s, mu_k, v_s, jitter, eta, stiffness, incipient = friction
    s_out, x_out = np.zeros(len(v) + 1), np.zeros(len(v) + 1)
    s, x, s_0 = 0.0, 0.0, 0.0
    slipping, drop, threshold, n_slips = False, 0.0, mu_s, 0
    for k in range(len(v)):
        place = x / line_step
        low = int(np.floor(place))
        part = place - low
        n = (1 - part) * line[low % len(line)] + part * line[(low + 1) % len(line)]
        rough = max(0.0, 1 + eta * n)
        fades = (mu_s - mu_k) * np.exp(-v[k] / v_s)
        reach = force[k] * rough / stiffness
        s_k = max(0.0, (mu_k - fades / 2) * reach)
        left = step
        for _ in range(_MOST_CHANGES):
            if not slipping:
                room = threshold * reach - s
                way, stuck = _way(room, threshold * reach - s_0) if incipient else (room, 1.0)
                if way >= v[k] * left:
                    carried = v[k] * left
                    if incipient and carried > 0:
                        stuck -= stuck * carried / way
                        carried = room - (threshold * reach - s_0) * stuck**3
                        x += v[k] * left - carried
                    s += carried
                    break
                # At once where the threshold fell below s; v is 0 only there.
                used = way / v[k] if way > 0 else 0.0
                if incipient and used > 0:
                    x += way - room
                    s += room
                else:
                    s += v[k] * used
                left -= used
                slipping, drop = True, s - s_k
                if drop <= 0:  # nothing holds the skin
                    slipping = False
                    x += v[k] * left
                    break
                continue
            over = s - s_k
            ends = LEAVES_AT * drop
            if over > ends:
                used = RELAXATION_S * np.log(over / ends)
                if used > left:
                    s = s_k + over * np.exp(-left / RELAXATION_S)
                    x += v[k] * left - (s - s_k - over)
                    break
                s = s_k + ends
                x += v[k] * used - (s - s_k - over)
                left -= used
            slipping, s_0 = False, s
            threshold = mu_k + fades * np.exp(jitter * normals[n_slips % len(normals)]) + FLOOR
            n_slips += 1
        s_out[k + 1] = s
        x_out[k + 1] = x
    return s_out, x_out


@compiled(forceinline=True)
def _way(room, span):  # type: ignore[no-untyped-def]
    """Return the way until a stick with incipient slip ends, mm, and (1 - phi)^(1/3)."""
    if room <= 0:
        return room, 0.0
    stuck = min(1.0, room / span) ** (1 / 3)
    return 3 * span * stuck, stuck
