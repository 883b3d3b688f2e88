/* Answer of a point in the gather pass, computed from the sums over its slices (totals.glsl). Before it, TINTED_FLOATS
 * must be defined: the number of floats before those of KILN_GLOSS. */

/* Clamps negative sums, which the harmonics of radiance probes may give: light is not negative. */
float at_least_zero(float sum) { return sum < 0.0 ? 0.0 : sum; }

/* Returns the answer of a point that is not valid. */
kiln_gpu_result no_answer()
{
    return kiln_gpu_result(float[3](0.0, 0.0, 0.0), float[3](0.0, 0.0, 0.0), 0.0, 0.0, 0.0, float[3](0.0, 0.0, 0.0),
                           float[3](0.0, 0.0, 0.0), 0.0, 0u);
}

kiln_gpu_result gather_answer(Totals totals, uint samples, float present)
{
    kiln_gpu_result r = no_answer();
    const float n = float(samples);
    for (uint c = 0u; c < 3u; c++) {
        r.incident[c] = at_least_zero(totals.sum[c]);
        r.irradiance[c] = at_least_zero(totals.sum[3u + c]);
        if (HAS_ALPHA >= KILN_PASSAGE_TINT)
            r.glass[c] = totals.sum[9u + c];
#ifdef KILN_GLOSS
        r.gloss[c] = totals.sum[TINTED_FLOATS + c];
#endif
    }
    r.escaped = totals.sum[6];
    r.blocked = totals.sum[7];
    r.count = samples;
    for (uint q = 0u; q < 4u; q++)
        totals.quarters[q] /= 0.25 * n;
    if (samples >= 4u)
        r.error = n * quarters_error(totals.quarters);
    if (r.escaped < 0.0)
        r.error = -1.0; /* the answer is not good */
    r.present = present;
    return r;
}
