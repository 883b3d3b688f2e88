/* Results of probe rays, kept for the light of groups: probes.comp, probes_groups.comp. Three arrays lie at push.found,
 * one after the other, each strided by push.count probes: the hit of each ray over the sphere; light samples with their
 * light (at most push.lights); and the number of light samples. */
KILN_ARRAY(FoundWords, uint, 4);

/* Codes instead of a surface point: a constant sky, with its group in the lower bits; a dark hit. */
const uint FOUND_SKY = 0x80000000u, FOUND_NOTHING = 0xffffffffu;

struct Found {
    vec3 direction;
    uint word;
};
struct FoundLight {
    vec3 direction, value; /* value: radiance x solid angle that arrives */
    uint group;            /* FOUND_NOTHING: nothing */
};
KILN_ARRAY(FoundArray, Found, 4);
KILN_ARRAY(FoundLights, FoundLight, 4);

FoundArray found_sphere(uint k, uint x) { return FoundArray(push.found + 16ul * (uint64_t(k) * push.count + x)); }
uint64_t found_lights_at() { return push.found + 16ul * (uint64_t(push.samples) * push.count); }
FoundLights found_light(uint k, uint x)
{
    return FoundLights(found_lights_at() + 28ul * (uint64_t(k) * push.count + x));
}
FoundWords found_lights(uint x)
{
    return FoundWords(found_lights_at() + 28ul * (uint64_t(push.lights) * push.count) + 4ul * x);
}
