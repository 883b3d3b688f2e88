/* Choices and samples of lights that a test asks for; body of vulkan_lights.comp (double) and vulkan_lights_float.comp.
 */
#include "shaders/kernel.glsl"

const uint CHOICES = 40u;

struct Query {
    float p[3], n[3], shading[3], place[3], spread; /* a sample is seen from `place`, which is within `spread` of p */
    uint limit, samples;                /* for choosing */
    uint kind, index, count, k;         /* sample k of a choice of `count` samples */
    uint pick, u, v;                    /* fractions */
};

struct Answer {
    double direction[3], distance, value[3], backoff;
    double sine, cosine, atan2, acos;
    uint aimed, brings, choices, reserved;
    uint what[CHOICES], given[CHOICES];
};

layout(push_constant, scalar) uniform Push
{
    KILN_ADDRESS scene, queries, answers;
    uint count;
} push;

#include "shaders/area_light_sampler.glsl"

KILN_ARRAY(Queries, Query, 4);
KILN_ARRAY(Answers, Answer, 8);

void choose(Query q, uint x)
{
    const real3 n = real3(vec3_of(q.n));
    const uint candidates = kiln_lights_choose(real3(vec3_of(q.p)), real(q.spread), n, q.limit, true);
    uint count = 0u;
    for (uint i = 0u; i < candidates; i++) {
        kiln_light_choice choice;
        if (!kiln_lights_candidate(i, n, q.samples, choice))
            continue;
        Answers(push.answers).at[x].what[count] = choice.kind << 30 | choice.index;
        Answers(push.answers).at[x].given[count++] = choice.samples;
    }
    Answers(push.answers).at[x].choices = count;
}

void sample_light(Query q, uint x)
{
    const kiln_light_choice choice = kiln_light_choice(q.kind, q.index, q.count);
    const real3 place = real3(vec3_of(q.place));
    kiln_light_sample s;
    const bool aimed = kiln_light_is_target(choice, vec3_of(q.p), q.spread);
    bool brings;
    if (aimed)
        brings = kiln_area_light_sampler_draw(kiln_area_light_sampler_of(choice.index, vec3_of(q.p)),
                                              place - real3(vec3_of(q.p)), real_unit(q.u), real_unit(q.v), s);
    else
        brings = kiln_sample_choice(choice, q.k, place, real3(vec3_of(q.n)), real3(vec3_of(q.shading)),
                                    real_unit(q.pick), real_unit(q.u), real_unit(q.v), s);
    Answers(push.answers).at[x].aimed = aimed ? 1u : 0u;
    Answers(push.answers).at[x].brings = brings ? 1u : 0u;
    for (uint c = 0u; c < 3u; c++) {
        Answers(push.answers).at[x].direction[c] = double(s.direction[c]);
        Answers(push.answers).at[x].value[c] = double(s.value[c]);
    }
    Answers(push.answers).at[x].distance = double(s.distance);
    Answers(push.answers).at[x].backoff = double(s.backoff);
}

void functions(Query q, uint x)
{
    real sine, cosine;
    const real half_ = real(0.5LF);
    real_sincos((real_unit(q.u) - half_) * 20, sine, cosine);
    Answers(push.answers).at[x].sine = double(sine);
    Answers(push.answers).at[x].cosine = double(cosine);
    Answers(push.answers).at[x].atan2 = double(real_atan2(real_unit(q.u) - half_, real_unit(q.v) - half_));
    Answers(push.answers).at[x].acos = double(real_acos(2 * real_unit(q.v) - 1));
}

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count)
        return;
    const Query q = Queries(push.queries).at[x];
    choose(q, x);
    sample_light(q, x);
    functions(q, x);
}

#include "shaders/main.glsl"
