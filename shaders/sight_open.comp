/* Before the pairs of a chunk: thread (x, y) unpacks word y of point x, the bits of visible pairs, from the stored
 * data. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_sight_push);

#include "shaders/sight.glsl"

KILN_ARRAY(OwnPatches, kiln_gpu_patch, 4);

/* Returns the states that occur among the pairs of the tile pair at `at`. */
uint found_of(uint at)
{
    return at < KILN_GPU_PAIRS_BITS         ? KILN_GPU_PAIRS_OPEN | KILN_GPU_PAIRS_SHUT
           : at == KILN_GPU_PAIRS_ALL_OPEN ? KILN_GPU_PAIRS_OPEN
           : at == KILN_GPU_PAIRS_ALL_SHUT ? KILN_GPU_PAIRS_SHUT
                                           : 0u;
}

void kiln_kernel(uint x, uint y)
{
    const uint groups = SightRef(push.sight).value.groups;
    if (x >= push.total || y >= 2u * groups)
        return;
    const uint place = OwnPatches(push.points).at[x].place_in_run;
    const kiln_gpu_sight_run run =
        SightRuns(SightRef(push.sight).value.runs).at[OwnPatches(push.points).at[x].run];
    if (run.words == 0ul)
        return;
    Words words = Words(run.words);
    const uint group = y / 2u, known = words.at[y], at = words.at[kiln_bits_at(groups) + group];
    uint open = at == KILN_GPU_PAIRS_ALL_OPEN ? known : 0u;
    if (at < KILN_GPU_PAIRS_BITS)
        open = Words(kiln_pair_bits(run, groups, at, place, y % 2u)).at[0];
    Words(kiln_open_word(push.open, y, push.total, x)).at[0] = open & known;
    if (place != 0u)
        return;
    words.at[kiln_partial_at(groups) + y] = 0u;
    if (y % 2u == 0u)
        words.at[kiln_found_at(groups) + group] = found_of(at);
}

#include "shaders/main.glsl"
