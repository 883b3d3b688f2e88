/* Answers of the guided pass: those of the gather pass, and in each point's answer some cells of its tile run, with the
 * root mean square of what the rays of the tile run's points have found there. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define HEMISPHERE_REDUCE_PUSH kiln_gpu_guided_reduce_push
#define GATHER_ANSWER(x, r) guided_answer(x, r)
#include "shaders/kernel.glsl"
#include "shaders/shared/guide.h"

void guided_answer(uint x, kiln_gpu_result r);
#include "shaders/gather_reduce.glsl"

KILN_ARRAY(GuidedArray, kiln_gpu_guided_result, 4);
KILN_ARRAY(GuidedRef, kiln_gpu_guided, 8);

/* Finds the largest biased exponent of the valid points among [first, last] of a tile run, and their number. False: the
 * device ended a loop early. */
bool learning_points(kiln_gpu_guided guided, uint first, uint last, out int exponent, out uint count)
{
    bool good = true;
    exponent = 0;
    count = 0u;
    for (uint q = first; q <= last; q++) {
        if (WordArray(push.chunk.states).at[push.chunk.origin + q] == KILN_GPU_STATE_INVALID)
            continue;
        const uint e = WordArray(guided.exponents).at[q];
        good = good && e != KILN_GPU_NONE;
        exponent = max(exponent, int(e));
        count++;
    }
    return good;
}

/* Root mean square of a cell's values, as if each cell had its share of rays by the cosine distribution. */
float root_mean_square(kiln_gpu_guided guided, uint cell, uint first, uint last, int exponent, float rays)
{
    kiln_sum sum = kiln_sum(0.0, 0.0);
    for (uint q = first; q <= last; q++) {
        if (WordArray(push.chunk.states).at[push.chunk.origin + q] == KILN_GPU_STATE_INVALID)
            continue;
        const float down = ldexp(1.0, max(int(WordArray(guided.exponents).at[q]) - exponent, -60)),
                    square = FloatArray(guided.squares + (uint64_t(cell) * push.chunk.total + q) * 4ul).at[0];
        kiln_add(sum, down * down * square);
    }
    return ldexp(sqrt(float_of(sum) / rays), exponent - KILN_GPU_GUIDE_BIAS);
}

void guided_answer(uint x, kiln_gpu_result r)
{
    const kiln_gpu_guided guided = GuidedRef(push.guided).at[0];
    const uint word = WordArray(guided.words).at[x], side = kiln_gpu_guide_side(word), cells = side * side,
               place = word & KILN_GPU_GUIDE_PLACE_MASK, first = x - place,
               last = first + (word >> KILN_GPU_GUIDE_LAST_SHIFT & KILN_GPU_GUIDE_PLACE_MASK);
    kiln_gpu_guided_result answer;
    int exponent;
    uint count;
    for (uint i = 0u; i < KILN_GUIDE_FLOATS; i++)
        answer.learnt[i] = 0.0;
    if (guided.squares != 0ul && side > 0u) {
        if (!learning_points(guided, first, last, exponent, count))
            r.error = -1.0; /* the answer is not good */
        const float rays = float(count) * float(push.samples) / float(cells);
        for (uint i = 0u; i < KILN_GUIDE_FLOATS && count > 0u; i++)
            if (KILN_GUIDE_FLOATS * place + i < cells)
                answer.learnt[i] =
                    root_mean_square(guided, KILN_GUIDE_FLOATS * place + i, first, last, exponent, rays);
    }
    answer.point = r;
    GuidedArray(push.results).at[x] = answer;
}
