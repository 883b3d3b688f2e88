/* Radiance probes that answer gather rays which end at the tracing range (worker/scene/radiance_probes.h), the same in
 * C and GLSL: their grid, the probe and direction that a ray looks up, and the map element of a direction.
 *
 * A map is one square (octahedral) or six (cube), of side x side elements each. A place on a map is a point of an
 * octahedron or a cube about the probe, and its direction is the direction of this point. The squares unfold without
 * stretching, so an area of the map at the point p has a solid angle proportional to 1 / |p|^3. */
#ifndef KILN_SHADERS_SHARED_RADIANCE_PROBE_H
#define KILN_SHADERS_SHARED_RADIANCE_PROBE_H

#include "shaders/shared/language.h"

/* Representations of a probe's radiance: coefficients of spherical harmonics (shaders/shared/harmonics.h), or the
 * radiance of each element of a map; three floats each. Rays for harmonics are distributed over an octahedral map. */
#define KILN_PROBE_HARMONICS 0u
#define KILN_PROBE_OCTAHEDRAL 1u
#define KILN_PROBE_CUBE 2u

/* A surface point's word of nearby probes. The upper bits are the cell of the grid that it lies in, by the number of
 * the cell's first corner. The lower KILN_PROBE_CORNERS bits say which corners have a probe that the point sees. Bit c
 * is the corner one step up x if c & 1, y if c & 2, z if c & 4. */
#define KILN_PROBE_CORNERS 8u
#define KILN_PROBE_SEEN 0xffu

struct kiln_probe_grid {
    KILN_VECTOR origin;    /* position of probe (0, 0, 0), m from the scene's centre */
    float spacing;         /* m */
    KILN_U32 size[3];      /* probe (x, y, z) has the number (z * size[1] + y) * size[0] + x */
    KILN_U32 basis;        /* KILN_PROBE_HARMONICS, ... */
    KILN_U32 side;         /* elements along a side of the map over which rays are distributed */
    KILN_U32 floats;       /* floats of a probe */
    float range;           /* m: gather rays end there */
    float projection;      /* m: distance along a ray of the place that its probe looks at; 0: end of the box */
    KILN_VECTOR low, high; /* the scene's box, m from its centre */
};

KILN_FUNCTION KILN_U32 kiln_probe_elements(KILN_U32 basis, KILN_U32 side)
{
    return basis == KILN_PROBE_CUBE ? 6u * side * side : side * side;
}

/* ---- maps ---- */

/* -1 below 0, else 1. */
KILN_FUNCTION float kiln_probe_sign(float x) { return x < 0.0f ? -1.0f : 1.0f; }

/* The point of the octahedron |x| + |y| + |z| = 1 at (u, v) of its map, both from -1 to 1. */
KILN_FUNCTION KILN_VECTOR kiln_octahedron_point(float u, float v)
{
    const float z = 1.0f - float_abs(u) - float_abs(v);
    if (z >= 0.0f)
        return vec3(u, v, z);
    return vec3((1.0f - float_abs(v)) * kiln_probe_sign(u), (1.0f - float_abs(u)) * kiln_probe_sign(v), z);
}

/* The point at (u, v) of a face of the cube max(|x|, |y|, |z|) = 1; faces +x -x +y -y +z -z. */
KILN_FUNCTION KILN_VECTOR kiln_cube_point(KILN_U32 face, float u, float v)
{
    const float along = (face & 1u) == 0u ? 1.0f : -1.0f;
    if (face < 2u)
        return vec3(along, u, v);
    if (face < 4u)
        return vec3(u, along, v);
    return vec3(u, v, along);
}

/* The point at the place (s, t), both from 0 to 1, of an element. */
KILN_FUNCTION KILN_VECTOR kiln_probe_point(KILN_U32 basis, KILN_U32 side, KILN_U32 element, float s, float t)
{
    const KILN_U32 square = element % (side * side);
    const float scale = 2.0f / KILN_TO_F32(side);
    const float u = (KILN_TO_F32(square % side) + s) * scale - 1.0f;
    const float v = (KILN_TO_F32(square / side) + t) * scale - 1.0f;
    if (basis == KILN_PROBE_CUBE)
        return kiln_cube_point(element / (side * side), u, v);
    return kiln_octahedron_point(u, v);
}

/* Returns the column or row of elements at u, from -1 to 1. */
KILN_FUNCTION KILN_U32 kiln_probe_column(float u, KILN_U32 side)
{
    return word_min(KILN_TO_U32(float_max((0.5f * u + 0.5f) * KILN_TO_F32(side), 0.0f)), side - 1u);
}

/* The element that direction d, of any length above 0, points at. */
KILN_FUNCTION KILN_U32 kiln_octahedron_element(KILN_U32 side, KILN_VECTOR d)
{
    const float scale = 1.0f / (float_abs(d.x) + float_abs(d.y) + float_abs(d.z));
    const float x = d.x * scale, y = d.y * scale;
    const float u = d.z >= 0.0f ? x : (1.0f - float_abs(y)) * kiln_probe_sign(x);
    const float v = d.z >= 0.0f ? y : (1.0f - float_abs(x)) * kiln_probe_sign(y);
    return kiln_probe_column(v, side) * side + kiln_probe_column(u, side);
}
KILN_FUNCTION KILN_U32 kiln_cube_element(KILN_U32 side, KILN_VECTOR d)
{
    const float x = float_abs(d.x), y = float_abs(d.y), z = float_abs(d.z);
    KILN_U32 face = d.x >= 0.0f ? 0u : 1u;
    float u = d.y / x, v = d.z / x;
    if (y > x && y >= z) {
        face = d.y >= 0.0f ? 2u : 3u;
        u = d.x / y;
        v = d.z / y;
    } else if (z > x) {
        face = d.z >= 0.0f ? 4u : 5u;
        u = d.x / z;
        v = d.y / z;
    }
    return (face * side + kiln_probe_column(v, side)) * side + kiln_probe_column(u, side);
}
KILN_FUNCTION KILN_U32 kiln_probe_element(KILN_U32 basis, KILN_U32 side, KILN_VECTOR d)
{
    return basis == KILN_PROBE_CUBE ? kiln_cube_element(side, d) : kiln_octahedron_element(side, d);
}

/* ---- the probe that a ray looks up ---- */

/* Relative position of a place in its cell along one axis, 0 to 1. */
KILN_FUNCTION float kiln_probe_fraction(float place, float origin, float spacing, KILN_U32 cell)
{
    return float_min(float_max((place - origin) / spacing - KILN_TO_F32(cell), 0.0f), 1.0f);
}

/* Trilinear weight of a corner, plus a small constant so that a lone visible corner has some weight everywhere. */
KILN_FUNCTION float kiln_probe_weight(KILN_U32 corner, KILN_VECTOR f)
{
    const float x = (corner & 1u) != 0u ? f.x : 1.0f - f.x;
    const float y = (corner & 2u) != 0u ? f.y : 1.0f - f.y;
    const float z = (corner & 4u) != 0u ? f.z : 1.0f - f.z;
    return x * y * z + 1.0e-4f;
}

/* Chooses one of the corners in the mask `seen` (at least one bit), in proportion to their weights at the relative
 * position f in the cell; u in (0, 1) is the random number. */
KILN_FUNCTION KILN_U32 kiln_probe_choose(KILN_U32 seen, KILN_VECTOR f, float u)
{
    float left = 0.0f;
    for (KILN_U32 c = 0u; c < KILN_PROBE_CORNERS; c++)
        left += (seen >> c & 1u) != 0u ? kiln_probe_weight(c, f) : 0.0f;
    left *= u;
    KILN_U32 chosen = 0u;
    bool found = false;
    for (KILN_U32 c = 0u; c < KILN_PROBE_CORNERS; c++) {
        if ((seen >> c & 1u) == 0u || found)
            continue;
        chosen = c;
        left -= kiln_probe_weight(c, f);
        found = left < 0.0f;
    }
    return chosen;
}

/* Distance at which a ray leaves a slab. */
KILN_FUNCTION float kiln_probe_leave(float at, float direction, float low, float high)
{
    if (direction == 0.0f)
        return 3.0e38f;
    return float_max(((direction > 0.0f ? high : low) - at) / direction, 0.0f);
}

/* Distance at which a ray from `at` leaves the scene's box, behind which there is nothing. */
KILN_FUNCTION float kiln_probe_far(KILN_STRUCT kiln_probe_grid grid, KILN_VECTOR at, KILN_VECTOR d)
{
    const float x = kiln_probe_leave(at.x, d.x, grid.low.x, grid.high.x);
    const float y = kiln_probe_leave(at.y, d.y, grid.low.y, grid.high.y);
    const float z = kiln_probe_leave(at.z, d.z, grid.low.z, grid.high.z);
    return float_min(x, float_min(y, z));
}

/* Direction in which a probe is looked up for a ray from `at` with direction d that leaves the box at `far`: from the
 * probe to the place where the ray leaves, or to a fixed distance along the ray (grid.projection). Not of unit length.
 */
KILN_FUNCTION KILN_VECTOR kiln_probe_direction(KILN_STRUCT kiln_probe_grid grid, KILN_VECTOR at, KILN_VECTOR d,
                                               float far, KILN_VECTOR probe)
{
    const float along = grid.projection > 0.0f ? grid.projection : far;
    const KILN_VECTOR to =
        vec3(at.x - probe.x + along * d.x, at.y - probe.y + along * d.y, at.z - probe.z + along * d.z);
    const bool is_none = !(to.x * to.x + to.y * to.y + to.z * to.z > 0.0f);
    return is_none ? d : to;
}

/* Index along one axis of the cell that a place lies in; outside the grid the nearest cell. */
KILN_FUNCTION KILN_U32 kiln_probe_cell_along(float at, float origin, float spacing, KILN_U32 size)
{
    const float last = KILN_TO_F32(size > 1u ? size - 2u : 0u);
    return KILN_TO_U32(float_min(float_max((at - origin) / spacing, 0.0f), last));
}

/* Mask of the corners that a cell has: along an axis on which the grid is one probe thick, only the first ones. */
KILN_FUNCTION KILN_U32 kiln_probe_corners(KILN_STRUCT kiln_probe_grid grid)
{
    return KILN_PROBE_SEEN & (grid.size[0] > 1u ? 0xffu : 0x55u) & (grid.size[1] > 1u ? 0xffu : 0x33u) &
           (grid.size[2] > 1u ? 0xffu : 0x0fu);
}

/* End of a gather ray as a share of the range. It lies a little before the range, so that a probe lookup begins on this
 * side of a wall that the ray has almost reached. */
#define KILN_PROBE_END 0.999f
/* Least distance, in spacings, from a visible probe to a surface behind it. Otherwise a probe beyond a thin wall would
 * seem to be on this side of it. */
#define KILN_PROBE_CLEAR 1.0e-3f
/* Value of the x coordinate of a probe that is switched off. */
#define KILN_PROBE_OFF 3.0e38f

#endif
