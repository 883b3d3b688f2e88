/* Finds the light vertices to connect with the vertex of the path in thread x's slot, or the photons to merge with it,
 * as FINDS selects. They are listed as pairs while there is room; the path stores where it stopped. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_both_push);

layout(constant_id = 6) const uint METHOD = KILN_GPU_PAIRS_CONNECTED; /* KILN_GPU_PAIRS_... alone */
const uint FINDS = METHOD & KILN_GPU_BOTH_FORM;
const bool POINTS = false; /* it makes no difference here */

#include "shaders/bidirectional.glsl"
#include "shaders/subpaths.glsl"

/* False: there is no room. */
bool make_pair(uint slot, uint other)
{
    const uint place = atomicAdd(TALLY.pairs, 1u);
    const bool fits = place < push.room;
    if (fits)
        Pairs(BOTH.pairs + 8ul * place).at[0] = kiln_gpu_both_pair(slot, other);
    else
        atomicAdd(TALLY.left, 1u);
    return fits;
}

bool near_enough(vec3 place, vec3 at)
{
    const vec3 d = place - at;
    return dot(d, d) <= float(real(BOTH.radius) * real(BOTH.radius));
}

bool may_connect(kiln_gpu_eye_vertex eye, kiln_gpu_light_vertex kept)
{
    const vec3 d = kept.position - eye.position;
    return dot(d, d) > 0.0 && int(BOTH.most) - int(eye.bounces) - int(kept.bounces) >= 0 &&
           kiln_path_allows(BOTH.path_length, eye.surface + kept.number + 3u) &&
           (eye.faces == 0u || dot(eye.normal, normalize(d)) > 0.0);
}

bool may_merge(kiln_gpu_eye_vertex eye, vec3 place, uint number)
{
    return near_enough(place, eye.position) && kiln_path_allows(BOTH.path_length, eye.surface + number + 2u);
}

/* Lists the vertices of the light path of the same pixel. */
void find_along_path(uint slot, kiln_gpu_eye_vertex eye)
{
    uint number = eye.vertex;
    bool fits = true;
    while (number != KILN_GPU_NONE && fits) {
        const kiln_gpu_light_vertex kept = LIGHT_VERTEX(number);
        if (FINDS == KILN_GPU_PAIRS_CONNECTED ? may_connect(eye, kept) : may_merge(eye, kept.position, kept.number))
            fits = make_pair(slot, number);
        if (fits)
            number = kept.previous;
    }
    EYE_VERTEX(slot).vertex = number;
}

/* Returns the offset of one of the 2 x 2 x 2 cells that contain the photons near a point. */
ivec3 corner_of(uint number) { return ivec3(number & 1u, number >> 1u & 1u, number >> 2u); }

/* Among all. */
void find_near(uint slot, kiln_gpu_eye_vertex eye)
{
    const ivec3 low = photon_cell(eye.position, KILN_RATIO(-1, 2));
    uint cell = eye.cell, photon = eye.photon, end = eye.photon_end;
    bool fits = true;
    while (fits && (photon < end || cell < 8u)) {
        if (photon == end) {
            const uint bucket = photon_bucket(low + corner_of(cell));
            photon = BothWords(BOTH.begins + 4ul * bucket).at[0];
            end = BothWords(BOTH.ends + 4ul * bucket).at[0];
            cell++;
        } else {
            Photons at = Photons(BOTH.photons + 52ul * photon);
            const vec3 place = at.at[0].position;
            /* cells share buckets, and two of the eight cells may have the same */
            if (near_enough(place, eye.position) && photon_cell(place, 0) == low + corner_of(cell - 1u) &&
                may_merge(eye, place, at.at[0].number))
                fits = make_pair(slot, photon);
            if (fits)
                photon++;
        }
    }
    EYE_VERTEX(slot).cell = cell;
    EYE_VERTEX(slot).photon = photon;
    EYE_VERTEX(slot).photon_end = end;
}

void kiln_kernel(uint x, uint y)
{
    if (y > 0u || !has_work(x))
        return;
    const uint slot = slot_of(x);
    const kiln_gpu_eye_vertex eye = EYE_VERTEX(slot);
    if (eye.triangle != KILN_GPU_NONE) {
        if (FINDS == KILN_GPU_PAIRS_NEAR)
            find_near(slot, eye);
        else
            find_along_path(slot, eye);
    }
    if (!still_loops(push.count))
        BothCounts(BOTH.counts).at[0].stopped = 1u;
}

#include "shaders/main.glsl"
