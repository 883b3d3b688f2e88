/* Samples of the lights without a preferred direction, numbered through all choices one after the other (lights.glsl).
 * The random numbers of a sample depend on `key` and on the choice's identity.
 *
 * The including kernel defines what a sample adds. Before this file it has lights.glsl, `struct Sums`, the sums of a
 * thread, and `struct Place`, the position that samples are drawn for. It defines add_light and calls light_samples. */

KILN_ARRAY(SobolArray, uint, 4);

/* Points of Sobol's sequence: dimension d's from word d * stride on. */
struct Sobol {
    uint64_t address;
    uint stride;
};

real scrambled(Sobol sobol, uint k, uint dimension, uint seed)
{
    return real_unit(kiln_owen_scramble(SobolArray(sobol.address).at[dimension * sobol.stride + k], seed));
}

/* Adds sample k of a choice; `identity` is the key of its random numbers. */
void add_light(inout Sums sums, inout Place place, kiln_light_choice choice, uint identity, uint k);

/* Draws sample k of a choice as seen from `position`; false when it brings nothing. */
bool draw_light(Sobol sobol, kiln_light_choice choice, uint identity, uint k, real3 position, out kiln_light_sample s)
{
    const real u = scrambled(sobol, k, KILN_DIMENSION_U, kiln_hash2(identity, 0u)),
               v = scrambled(sobol, k, KILN_DIMENSION_V, kiln_hash2(identity, 1u));
    const real pick = scrambled(sobol, k, KILN_DIMENSION_CHOICE, kiln_hash2(identity, 2u));
    return kiln_sample_choice(choice, k, position, real3(0), real3(0), pick, u, v, s);
}

/* Returns the number of samples of all candidates; `n` as in kiln_lights_choose. */
uint light_sample_count(uint candidates, real3 n, uint samples)
{
    uint count = 0u;
    kiln_light_choice choice;
    for (uint i = 0u; i < candidates; i++)
        if (kiln_lights_candidate(i, n, samples, choice))
            count += choice.samples;
    return count;
}

/* Adds the samples from .. to - 1 among the samples of all candidates. False: the device ended a loop early. */
bool light_samples(inout Sums sums, inout Place place, uint candidates, real3 n, uint samples, uint key, uint from,
                   uint to)
{
    bool stopped = false;
    uint before = 0u; /* samples of the choices so far */
    uint i = 0u;
    for (; i < candidates && before < to; i++) {
        kiln_light_choice choice;
        if (!kiln_lights_candidate(i, n, samples, choice))
            continue;
        const uint identity = kiln_hash2(key, kiln_choice_identity(choice.kind, choice.index));
        const uint begin = max(from, before) - before, end = min(to - before, choice.samples);
        uint k = begin;
        for (; k < end; k++)
            add_light(sums, place, choice, identity, k);
        stopped = stopped || k < end;
        before += choice.samples;
    }
    return !(stopped || (i < candidates && before < to));
}
