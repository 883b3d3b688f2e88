/* After the pairs of a chunk: thread x updates, for each group of tile run x, what is known of it. Groups get room for
 * bits in their order while there is any, so that the stored data depend on nothing else. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_sight_push);

#include "shaders/sight.glsl"

/* Returns where the bits of a tile pair are stored, some of whose pairs were found in this step. */
uint place_of(uint at, uint found, uint room, inout uint used)
{
    const uint both = KILN_GPU_PAIRS_OPEN | KILN_GPU_PAIRS_SHUT;
    if ((found & both) != both)
        return (found & KILN_GPU_PAIRS_OPEN) != 0u   ? KILN_GPU_PAIRS_ALL_OPEN
               : (found & KILN_GPU_PAIRS_SHUT) != 0u ? KILN_GPU_PAIRS_ALL_SHUT
                                                     : KILN_GPU_PAIRS_NONE;
    if (at < KILN_GPU_PAIRS_BITS)
        return at;
    return used < room ? used++ : KILN_GPU_PAIRS_NONE;
}

void kiln_kernel(uint x, uint y)
{
    const uint groups = SightRef(push.sight).value.groups;
    if (x >= push.runs || y > 0u)
        return;
    SightRuns runs = SightRuns(SightRef(push.sight).value.runs);
    kiln_gpu_sight_run run = runs.at[push.run_first + x];
    if (run.words == 0ul)
        return;
    Words words = Words(run.words), columns = Words(push.columns);
    run.open = run.shut = run.mixed = run.unknown = 0u;
    for (uint g = 0u; g < groups; g++) {
        const uint found = words.at[kiln_found_at(groups) + g];
        uint at = words.at[kiln_bits_at(groups) + g];
        if ((found & KILN_GPU_PAIRS_NEW) != 0u) {
            at = place_of(at, found, run.room, run.used);
            words.at[kiln_bits_at(groups) + g] = at;
            for (uint i = 2u * g; i < 2u * g + 2u; i++)
                words.at[i] = at == KILN_GPU_PAIRS_NONE
                                  ? 0u
                                  : (words.at[i] | columns.at[i]) & ~words.at[kiln_partial_at(groups) + i];
        }
        run.open += at == KILN_GPU_PAIRS_ALL_OPEN ? 1u : 0u;
        run.shut += at == KILN_GPU_PAIRS_ALL_SHUT ? 1u : 0u;
        run.mixed += at < KILN_GPU_PAIRS_BITS ? 1u : 0u;
        run.unknown += at == KILN_GPU_PAIRS_NONE ? 1u : 0u;
    }
    runs.at[push.run_first + x] = run;
}

#include "shaders/main.glsl"
