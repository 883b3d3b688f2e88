/* Shadow rays: the kernel of direct.comp, and of direct_precise.comp (KILN_PRECISE). Thread (x, y) works for point x.
 * The samples of each choice of lights (struct kiln_light_choice) are cut into four quarters, and a quarter into
 * slices. The thread traces the same slice of every choice: number row_first + y of all quarters' slices (struct
 * kiln_gpu_direct). A choice with few samples is not cut: one thread has all of them, and the threads take turns.
 * Neighbouring threads take the same sample of neighbouring points. */
#include "shaders/kernel.glsl"
#include "shaders/direct.glsl"

#define KILN_TRACES
#include "shaders/trace/trace.glsl"
#include "shaders/surface.glsl"
#include "shaders/position.glsl"
#include "shaders/direct_sequence.glsl"
#include "shaders/taken_up.glsl"
#include "shaders/light_groups.glsl"
#ifndef KILN_PRECISE
#    include "shaders/area_light_sampler.glsl"
#endif

layout(constant_id = 6) const uint GROUPED = 0u; /* light of groups is stored as well (direct_groups.comp) */
uint64_t group_row;                              /* the thread's among all */
uint group_kind, group_index;                    /* of the choice under way, */
real group_scale;                                /* and 1 over its samples */

/* Work of a thread: one slice of one point's samples. */
struct Row {
    uint index;     /* the point's, or KILN_GPU_NONE: nothing */
    uint slot;      /* the point's in the chunk */
    uint slices;    /* of a quarter */
    uint part, row; /* slice of all four quarters; row of the sums */
};

Row row_of(uint x, uint y)
{
    Row r;
    r.index = kiln_point_of_thread(push.chunk, x);
    r.slot = r.index - push.chunk.origin;
    r.slices = 0u;
    r.part = push.pass.row_first + y;
    r.row = 0u;
    if (r.index == KILN_GPU_NONE)
        return r;
    uint split;
    direct_slices(DirectWords(push.chunk.states).at[r.index], DRAW_AGAIN != 0u, r.slices, split);
    r.row = r.part * split;
    if (r.part >= 4u * r.slices)
        r.index = KILN_GPU_NONE;
    return r;
}

/* Range of samples, begin .. end-1, of a choice's `samples` that the row traces; empty if all belong to another row. */
void share_of(Row r, uint i, uint samples, out uint begin, out uint end)
{
    begin = 0u;
    end = i % (4u * r.slices) == r.part ? samples : 0u;
    if (samples < KILN_QUARTERS_FROM)
        return;
    /* quarter q holds the samples k with k * 4 / samples == q; 2^20 samples and 1024 slices fit 32 bits, whose division
     * is fast */
    const uint quarter = r.part / r.slices, slice = r.part % r.slices;
    const uint first = (quarter * samples + 3u) / 4u, last = ((quarter + 1u) * samples + 3u) / 4u;
    begin = first + (last - first) * slice / r.slices;
    end = first + (last - first) * (slice + 1u) / r.slices;
}

/* Sums over the samples of one choice of lights (struct kiln_light_choice), not yet divided by their number. */
struct Sums {
    real3 incident, irradiance;
    real luminance, square; /* of irradiance: sum, and sum of squares */
    uint rays;
};

/* Variance of the mean of few samples, as if they were independent (shadow_variance). */
real few_variance(Sums sums, real samples)
{
    const real mean = sums.luminance / samples;
    return samples < 2 ? mean * mean : max(real(0), sums.square / samples - mean * mean) / (samples - 1);
}

/* Totals of a row, added up choice by choice. */
struct Total {
    real3 incident, irradiance;
    real variance;
    uint rays, stopped;
};

void add_choice(inout Total total, Row r, uint i, uint samples, Sums sums)
{
    const real scale = 1 / real(samples);
    total.incident += sums.incident * scale;
    total.irradiance += sums.irradiance * scale;
    total.rays += sums.rays;
    if (samples >= KILN_QUARTERS_FROM)
        direct_luminance(i, r.slot, r.row).at[0] = float(sums.luminance);
    else
        total.variance += few_variance(sums, real(samples));
}

void store_total(Row r, Total t)
{
    direct_sums(r.slot, r.row).at[0] =
        kiln_gpu_direct_sums(stored[3](t.incident.x, t.incident.y, t.incident.z),
                             stored[3](t.irradiance.x, t.irradiance.y, t.irradiance.z), t.variance, t.rays, t.stopped);
}

/* Adds the light of a sample to its group. */
void add_to_group(uint group, real3 incident, real3 irradiance)
{
    for (uint c = 0u; c < GROUP_FLOATS; c++) {
        const real value = c < 3u ? incident[c] : irradiance[c - 3u];
        DirectFloats(uint64_t(direct_groups(group * GROUP_FLOATS + c)) + 4ul * group_row).at[0] +=
            float(group_scale * value);
    }
}

/* Adds a sample to the sums, weighted as the surface sees it, unless its shadow ray is blocked. The ray starts `off`
 * the surface. */
void add_light(inout Sums sums, kiln_gpu_point p, vec3 position, vec3 n, real3 off, kiln_light_sample s)
{
    const real above = dot(real3(n), s.direction), cosine = max(real(0), above);
    const bool smooth_point = HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_SMOOTH) != 0u;
    const real shading_cosine = smooth_point ? max(real(0), dot(real3(kiln_shading(p, n)), s.direction)) : cosine;
    if (!kiln_faces(p, float(above), float(shading_cosine)))
        return;
    float limit;
    const vec3 towards = kiln_shadow_ray(s, off, limit);
    sums.rays++;
    const vec3 through = kiln_through(position, towards, limit);
    if (through == vec3(0.0))
        return;
    if (HAS_ALPHA >= KILN_PASSAGE_BLEND)
        s.value *= real3(through);
    const real3 irradiance = s.value * shading_cosine;
    const real luminance = real_luminance(irradiance);
    if (HAS_GLOSSY != 0u)
        sums.incident += s.value * (cosine * real(kiln_taken_up(p, push.chunk.parts, float(shading_cosine))));
    else
        sums.incident += s.value * cosine;
    sums.irradiance += irradiance;
    sums.luminance += luminance;
    sums.square += luminance * luminance;
    if (GROUPED != 0u)
        add_to_group(light_group(group_kind, group_index, s, real3(position) - off), s.value * cosine, irradiance);
}

/* Draws sample k of a choice; with KILN_PRECISE of a single area light. `place`: the position without its offset. */
bool draw_light(kiln_light_choice choice, uint i, real3 place, real3 n, real3 shading, Sequence sequence, uint k,
                out kiln_light_sample s)
{
    const real u = real_unit(draw(sequence, k, KILN_DIMENSION_U)), v = real_unit(draw(sequence, k, KILN_DIMENSION_V));
#ifdef KILN_PRECISE
    const uint light = LightNodes(SCENE.lights.nodes).at[choice.index].right;
    s.light = light;
    return kiln_sample_area_light(kiln_lights_areas(light), place, 1, u, v, s);
#else
    return kiln_sample_choice(choice, i, place, n, shading, real_unit(draw(sequence, k, KILN_DIMENSION_CHOICE)), u, v,
                              s);
#endif
}

#ifndef KILN_PRECISE
/* The same of a lone area light, of which much is known for all positions of a point. `from`: relative to its centre.
 */
bool draw_target(kiln_area_light_sampler target, real3 from, Sequence sequence, uint k, out kiln_light_sample s)
{
    return kiln_area_light_sampler_draw(target, from, real_unit(draw(sequence, k, KILN_DIMENSION_U)),
                                        real_unit(draw(sequence, k, KILN_DIMENSION_V)), s);
}
#endif

/* Samples begin .. end-1 of a choice. One loop for lights of both kinds, so that the code for positions and shadow rays
 * exists once. */
Sums sample_choice(kiln_gpu_point p, uint kind, uint index, uint samples, uint begin, uint end, inout uint stopped)
{
#ifdef KILN_PRECISE
    const bool is_target = false;
#else
    const bool is_target = light_kind(KILN_GPU_KIND_AREA) && kind == KILN_GPU_CHOICE_TARGET;
    kiln_area_light_sampler target;
    if (light_kind(KILN_GPU_KIND_AREA) && is_target)
        target = kiln_area_light_sampler_of(index, p.centre);
#endif
    const kiln_light_choice choice = kiln_light_choice(is_target ? KILN_CHOICE_LIGHT_NODE : kind, index, samples);
    const uint identity = kiln_direct_identity(choice.kind, choice.index, push.pass.stream),
               strategies = is_target ? 1u : kiln_choice_strategies(choice, real3(p.normal));
    Sums sums = Sums(real3(0), real3(0), 0, 0, 0u);
    Sequence sequence = sequence_of(p, identity);
    uint i = begin;
    for (; i < end; i++) {
        const uint k = i / strategies;
        vec3 position, n;
        float offset;
        bool drawn;
        kiln_light_sample s;
        if (strategies > 1u)
            sequence = sequence_of(p, identity + i % strategies);
        kiln_position(p, push.chunk.parts, float(real_unit(draw(sequence, k, KILN_DIMENSION_S))),
                      float(real_unit(draw(sequence, k, KILN_DIMENSION_T))), position, n, offset);
        const real3 off = real3(n) * real(offset);
#ifndef KILN_PRECISE
        if (light_kind(KILN_GPU_KIND_AREA) && is_target)
            drawn = draw_target(target, real3(position - p.centre) - off, sequence, k, s);
        else
#endif
            drawn = draw_light(choice, i, real3(position) - off, real3(n), real3(kiln_shading(p, n)), sequence, k, s);
        if (drawn)
            add_light(sums, p, position, n, off, s);
    }
    stopped |= i < end ? 1u : 0u;
    return sums;
}

/* Whether a choice is this kernel's. */
bool is_own(kiln_gpu_choice choice)
{
#ifdef KILN_PRECISE
    return (choice.samples & KILN_GPU_CHOICE_PRECISE) != 0u;
#else
    return (choice.samples & KILN_GPU_CHOICE_PRECISE) == 0u;
#endif
}

void kiln_kernel(uint x, uint y)
{
    const Row r = row_of(x, y);
    if (r.index == KILN_GPU_NONE)
        return;
    const uint counts = direct_counts().at[r.slot], count = counts & ~KILN_GPU_COUNT_PRECISE;
    Total total = Total(real3(0), real3(0), 0, 0u, 0u);
#ifdef KILN_PRECISE
    if ((counts & KILN_GPU_COUNT_PRECISE) == 0u)
        return;
    const kiln_gpu_direct_sums before = direct_sums(r.slot, r.row).at[0];
    total = Total(real3_of(before.incident), real3_of(before.irradiance), before.variance, before.rays, before.stopped);
#endif
    const kiln_gpu_point p = PointArray(push.chunk.points).at[r.index];
    if (GROUPED != 0u)
        group_row = direct_row(r.slot, r.row);
    uint i = 0u;
    for (; i < count; i++) {
        const kiln_gpu_choice packed = direct_choice(i).at[r.slot];
        const uint kind = packed.what >> KILN_GPU_CHOICE_KIND_SHIFT,
                   index = packed.what & ((1u << KILN_GPU_CHOICE_KIND_SHIFT) - 1u);
        const uint samples = packed.samples & ~KILN_GPU_CHOICE_PRECISE;
        uint begin, end;
        share_of(r, i, samples, begin, end);
        if (!is_own(packed) || (begin >= end && samples < KILN_QUARTERS_FROM))
            continue;
        group_kind = kind == KILN_GPU_CHOICE_TARGET ? KILN_CHOICE_LIGHT_NODE : kind;
        group_index = index;
        group_scale = 1 / real(samples);
        const Sums sums = sample_choice(p, kind, index, samples, begin, end, total.stopped);
        add_choice(total, r, i, samples, sums);
    }
    total.stopped |= i < count ? 1u : 0u;
    store_total(r, total);
}

#include "shaders/main.glsl"
