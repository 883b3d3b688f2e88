/* Box of a target as seen from a point. worker/light/targets.c keeps the visible parts; here they are found again for
 * each draw, since all of them would take too many registers. */
struct kiln_box_seen {
    real3 low, high; /* from the place, m */
    real omega;      /* sr, of all parts */
};

const uint BOX_PARTS = 6u;

/* Finds part `part` of the visible sides of a box, whose corners are relative to the point: each pair of opposite sides
 * has two parts, as triangles. False: the point does not see that side. */
bool box_part(real3 low, real3 high, uint part, out kiln_spherical_triangle t)
{
    const uint axis = part / 2u, b = (axis + 1u) % 3u, c = (axis + 2u) % 3u;
    const bool is_low = low[axis] > 0;
    real3 corner = low, e1 = real3(0), e2 = real3(0);
    if (!is_low)
        corner[axis] = high[axis];
    e1[b] = high[b] - low[b];
    e2[c] = high[c] - low[c];
    if ((part & 1u) != 0u) {
        corner += e1 + e2;
        e1 = -e1;
        e2 = -e2;
    }
    t = kiln_spherical_triangle_of(corner, e1, e2, (high[b] - low[b]) * (high[c] - low[c]) / 2,
                                   is_low ? low[axis] : -high[axis]);
    return is_low || high[axis] < 0;
}

/* Whether the box is seen from `from` under less than `most` sr. */
bool kiln_target_see_box(kiln_target target, real3 from, real most, out kiln_box_seen seen)
{
    seen.low = target.low - from;
    seen.high = target.high - from;
    seen.omega = 0;
    bool is_seen = true;
    for (uint part = 0u; part < BOX_PARTS; part++) {
        kiln_spherical_triangle t;
        if (box_part(seen.low, seen.high, part, t)) {
            is_seen = is_seen && t.omega > 0 && kiln_target_is_apart(t);
            seen.omega += t.omega;
        }
    }
    return is_seen && seen.omega > KILN_SPHERICAL_LEAST && seen.omega < most;
}

/* Draws a unit direction to the box, uniform in solid angle. */
real3 kiln_box_direction(kiln_box_seen seen, real pick, real u, real v)
{
    real left = pick * seen.omega;
    kiln_spherical_triangle t, found;
    bool searching = true;
    for (uint part = 0u; part < BOX_PARTS; part++) {
        if (box_part(seen.low, seen.high, part, t) && searching) {
            found = t; /* the last part, if rounding leaves none */
            searching = left >= t.omega;
            left -= t.omega;
        }
    }
    return kiln_spherical_triangle_direction(found, u, v);
}
