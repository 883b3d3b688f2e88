/* Sums of the radiance that arrives at a probe: probes.comp, probes_groups.comp. Before it stand
 * shaders/shared/harmonics.h and `struct Sums` with the members radiance[KILN_HARMONICS] and axes[6]. */

/* Adds radiance x solid angle `value` that arrives from direction d: shaders/shared/harmonics.h. */
void add_direction(inout Sums sums, vec3 d, vec3 value)
{
#define KILN_ADD(index, y) sums.radiance[index] += y * value;
    KILN_HARMONICS_EACH(KILN_ADD, d)
#undef KILN_ADD
    const vec3 positive = max(d, 0.0), negative = max(-d, 0.0);
    for (int a = 0; a < 3; a++) {
        sums.axes[2 * a] += positive[a] * value;
        sums.axes[2 * a + 1] += negative[a] * value;
    }
}
