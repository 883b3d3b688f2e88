/* Adds the findings of a slice's rays, in the gather or the weighed pass, to its sums, from its first ray that met
 * gloss on (gather_chains.glsl). Thread (x, y): slice y of point x. Or, before the rays are traced, resets the number
 * of chains. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS 1
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"
#include "shaders/shared/streams.h"

KILN_PUSH(kiln_gpu_chains_push);
#define APART_POINTS push.points
#define APART_SAMPLES push.samples
#define APART_ROWS push.rows
#define APART_ROOM push.room
#define APART_RAY_BYTES uint64_t(push.ray_bytes)

const uint ADDS = 0u, BEGINS = 1u, ADDS_WEIGHED = 2u;
layout(constant_id = 6) const uint DOES = ADDS; /* ADDS: after the gather pass; BEGINS: before the rays of any pass */

#include "shaders/apart.glsl"
#include "shaders/gather_sums.glsl"

KILN_ARRAY(FloatArray, float, 4);

const uint FLOATS = DOES == ADDS_WEIGHED ? TINTED_FLOATS : SLICE_FLOATS;

void add(uint x, uint row)
{
    const uint first = ApartWords(apart_slice(row, x)).at[0], q = row / push.per_quarter;
    const uint begin = kiln_quarter_first(q, push.samples), end = kiln_quarter_first(q + 1u, push.samples),
               from = begin + (row % push.per_quarter) * push.slice, to = min(end, from + push.slice);
    if (first >= to) /* no ray of it has */
        return;
    FloatArray floats = FloatArray(push.slices + 4ul * (uint64_t(row) * FLOATS) * uint64_t(push.points));
    float sums[SLICE_FLOATS_MOST];
    for (uint c = 0u; c < FLOATS; c++)
        sums[c] = floats.at[c * push.points + x];
    for (uint k = max(first, from); k < to; k++) {
        FloatArray found = FloatArray(apart_ray(k, x));
        for (uint c = 0u; c < FLOATS; c++)
            sums[c] += found.at[c < TINTED_FLOATS ? c : c - TINTED_FLOATS + KILN_GPU_SLICE_TINTED_FLOATS];
    }
    for (uint c = 0u; c < FLOATS; c++)
        floats.at[c * push.points + x] = sums[c];
}

void kiln_kernel(uint x, uint y)
{
    if (DOES == BEGINS && x == 0u && y == 0u)
        APART_COUNT = 0u;
    else if (DOES != BEGINS && x < push.points && push.row_first + y < push.row_last)
        add(x, push.row_first + y);
}

#include "shaders/main.glsl"
