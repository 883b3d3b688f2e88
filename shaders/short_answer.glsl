/* A point's answer for the host, without values that the host can compute itself. Its layout is in
 * shaders/shared/layout.h, the host's code in worker/backend/vulkan/answers.h. */
KILN_ARRAY(ResultArray, kiln_gpu_result, 4);
KILN_ARRAY(ShortFloats, float, 4);
KILN_ARRAY(ShortWords, uint, 4);
layout(constant_id = 6) const uint SHORT = 0u; /* else struct kiln_gpu_result */

void put(uint64_t results, inout uint at, float value) { ShortFloats(results).at[at++] = value; }
void put_colors(uint64_t results, inout uint at, float values[3])
{
    for (uint c = 0u; c < 3u; c++)
        put(results, at, values[c]);
}

/* `gathers`: the answer includes the shares of gather rays that escaped or were blocked, and of light absorbed on the
 * way. */
void put_short(uint64_t results, uint x, kiln_gpu_result r, bool gathers, uint samples)
{
    const bool mixed = HAS_SMOOTH != 0u || HAS_GLOSSY != 0u, tints = gathers && HAS_ALPHA >= KILN_PASSAGE_TINT,
               gloss = gathers && HAS_GLOSSY != 0u, whole = !mixed && samples <= KILN_GPU_SHORT_MOST;
    uint at = x * (KILN_GPU_SHORT_RAYS + (gathers ? (whole ? 1u : 2u) : 0u) + (mixed ? 3u : 0u) + (tints ? 3u : 0u) +
                   (gloss ? 3u : 0u) + (HAS_ALPHA != 0u ? 1u : 0u));
    put_colors(results, at, r.incident);
    put(results, at, r.error);
    if (gathers && whole) {
        ShortWords(results).at[at++] = uint(r.escaped) | uint(r.blocked) << 16;
    } else if (gathers) {
        put(results, at, r.escaped);
        put(results, at, r.blocked);
    }
    if (mixed)
        put_colors(results, at, r.irradiance);
    if (tints)
        put_colors(results, at, r.glass);
    if (gloss)
        put_colors(results, at, r.gloss);
    if (HAS_ALPHA != 0u)
        put(results, at, r.present);
}

void put_answer(uint64_t results, uint x, kiln_gpu_result r, bool gathers, uint samples)
{
    if (SHORT != 0u)
        put_short(results, x, r, gathers, samples);
    else
        ResultArray(results).at[x] = r;
}
