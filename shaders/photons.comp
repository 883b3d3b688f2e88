/* Sorts light vertices into buckets, where paths of pixels search for them: counts the vertices of each bucket, assigns
 * each its place, fills them. The order in a bucket does not matter, since merged light is summed in integers. An
 * earlier step clears words: those of the buckets, and the sums of paths. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/real.glsl"

KILN_PUSH(kiln_gpu_both_push);

KILN_ARRAY(BothArray, kiln_gpu_both, 8);
#define BOTH BothArray(push.both).at[0]
KILN_ARRAY(BothCounts, kiln_gpu_both_counts, 4);
KILN_ARRAY(LightVertices, kiln_gpu_light_vertex, 4);
KILN_ARRAY(Photons, kiln_gpu_photon, 4);
KILN_ARRAY(BothWords, uint, 4);

#include "shaders/photon_cells.glsl"

void count_vertex(uint x)
{
    const vec3 place = LightVertices(BOTH.vertices + 80ul * x).at[0].position;
    atomicAdd(BothWords(BOTH.ends).at[photon_bucket(photon_cell(place, 0))], 1u);
}

void begin_bucket(uint x)
{
    const uint count = BothWords(BOTH.ends).at[x];
    const uint begin = count > 0u ? atomicAdd(BothCounts(BOTH.counts).at[0].photons, count) : 0u;
    BothWords(BOTH.begins).at[x] = begin;
    BothWords(BOTH.ends).at[x] = begin;
}

void place_vertex(uint x)
{
    const kiln_gpu_light_vertex v = LightVertices(BOTH.vertices + 80ul * x).at[0];
    const uint place = atomicAdd(BothWords(BOTH.ends).at[photon_bucket(photon_cell(v.position, 0))], 1u);
    Photons(BOTH.photons + 52ul * place).at[0] =
        kiln_gpu_photon(v.position, v.from, v.flux, v.vcm, v.vm, v.bounces, v.number);
}

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count || y > 0u)
        return;
    if (push.stage == KILN_GPU_PHOTONS_CLEAR)
        BothWords(push.sums).at[x] = 0u;
    else if (push.stage == KILN_GPU_PHOTONS_COUNT)
        count_vertex(push.offset + x);
    else if (push.stage == KILN_GPU_PHOTONS_BEGIN)
        begin_bucket(push.offset + x);
    else
        place_vertex(push.offset + x);
}

#include "shaders/main.glsl"
