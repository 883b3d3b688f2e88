/* After sight_close.comp: thread (x, y) stores word y of point x, if its tile pair has bits and something new was
 * found. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_sight_push);

#include "shaders/sight.glsl"

KILN_ARRAY(OwnPatches, kiln_gpu_patch, 4);

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
    const uint group = y / 2u, at = words.at[kiln_bits_at(groups) + group];
    if (at < KILN_GPU_PAIRS_BITS && (words.at[kiln_found_at(groups) + group] & KILN_GPU_PAIRS_NEW) != 0u)
        Words(kiln_pair_bits(run, groups, at, place, y % 2u)).at[0] =
            Words(kiln_open_word(push.open, y, push.total, x)).at[0];
}

#include "shaders/main.glsl"
