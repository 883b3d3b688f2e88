/* Choices among lights: kiln_lights_choices and kiln_lights_allot of worker/light/lights.c. Their list would take many
 * registers here, so choices are computed anew whenever they are needed, in the same order.
 *
 *   uint candidates = kiln_lights_choose(p, spread, n, limit, sky); // limit <= KILN_CUT_MAX
 *   for (uint i = 0u; i < candidates; i++)
 *       if (kiln_lights_candidate(i, n, samples, choice)) ...       // with its samples
 *
 * n is the geometric normal; the zero vector for a probe: every direction counts. `sky` false leaves the environment
 * out. A thread has one set of candidates at a time. Needs shaders/lights.glsl before it. */
real sky_importance() { return kiln_sky_importance(real_luminance(real3(vec3_of(SCENE.lights.mean)))); }

uint kiln_lights_choose(real3 p, real spread, real3 n, uint limit, bool sky)
{
    cut_count = 0u;
    cut_leaves = 0u;
    cut_total = 0;
    /* no nodes: in the direct pass if lamps are patches; other kernels always have nodes */
    if (light_kind(KILN_GPU_KIND_AREA | KILN_GPU_KIND_PUNCTUAL) && SCENE.lights.nodes != 0ul)
        cut_count = kiln_cut_tree(0u, p, spread, n, limit);
    for (uint i = 0u; i < cut_count; i++)
        cut_total += cut_importance[i];
    uint candidates = cut_count;
    if (light_kind(KILN_GPU_KIND_SUN)) {
        for (uint i = 0u; i < SCENE.lights.directional_count; i++)
            cut_total += kiln_sun_importance_at(i, n);
        candidates += SCENE.lights.directional_count;
    }
    if (light_kind(KILN_GPU_KIND_SKY | KILN_GPU_KIND_IMAGE) && sky && SCENE.lights.environment != 0u) {
        cut_total += sky_importance();
        candidates++;
    }
    return candidates;
}

bool kiln_lights_candidate(uint i, real3 n, uint samples, out kiln_light_choice choice)
{
    const uint suns = light_kind(KILN_GPU_KIND_SUN) ? SCENE.lights.directional_count : 0u;
    real importance;
    if (i < cut_count) {
        choice.kind = KILN_CHOICE_LIGHT_NODE;
        choice.index = cut_node[i];
        importance = cut_importance[i];
    } else if (i - cut_count < suns) {
        choice.kind = KILN_CHOICE_DIRECTIONAL;
        choice.index = i - cut_count;
        importance = kiln_sun_importance_at(choice.index, n);
    } else {
        choice.kind = KILN_CHOICE_ENVIRONMENT;
        choice.index = 0u;
        importance = sky_importance();
    }
    choice.samples = kiln_choice_samples(importance / cut_total, samples);
    return importance > 0;
}
