/* Common code of the direct pass's kernels: choose.comp, direct_pilot.comp, direct.comp, direct_precise.comp,
 * direct_reduce.comp, direct_groups.comp. Their push constants are the same. */

KILN_PUSH(kiln_gpu_direct_push);

#include "shaders/lights.glsl"
#include "shaders/shared/slices.h"
#include "shaders/shared/streams.h"
#include "shaders/shared/sun_pilot.h"

KILN_ARRAY(DirectSums, kiln_gpu_direct_sums, 8);
KILN_ARRAY(DirectChoices, kiln_gpu_choice, 4);
KILN_ARRAY(DirectFloats, float, 4);
KILN_ARRAY(DirectWords, uint, 4);

#ifdef KILN_FLOAT64
const uint64_t DIRECT_SUMS_BYTES = 64ul;
#else
const uint64_t DIRECT_SUMS_BYTES = 36ul;
#endif

/* Whether points differ in their number of samples, and so in their number of rows. */
bool direct_is_mixed() { return push.pass.samples == 0u; }
/* Number of rows that all points have room for. */
uint64_t direct_rows()
{
    return direct_is_mixed() ? uint64_t(push.pass.slices)
                             : 4ul * push.pass.slices * push.pass.split * uint64_t(push.pass.room);
}
/* Index of a row of point x among all rows. */
uint64_t direct_row(uint x, uint row)
{
    if (!direct_is_mixed())
        return uint64_t(row) * push.pass.room + x;
    const uint place = DirectWords(push.pass.scratch).at[x];
    return (place & (1u << KILN_GPU_DIRECT_ROW_BITS) - 1u) + uint64_t(row) * ((place >> KILN_GPU_DIRECT_ROW_BITS) + 1u);
}

uint64_t direct_sums_at() { return push.pass.scratch + (direct_is_mixed() ? 8ul * ((push.pass.room + 1u) / 2u) : 0ul); }
uint64_t direct_choices_at() { return direct_sums_at() + DIRECT_SUMS_BYTES * direct_rows(); }
uint64_t direct_luminances_at() { return direct_choices_at() + 8ul * push.pass.slots * push.pass.room; }
uint64_t direct_counts_at() { return direct_luminances_at() + 4ul * push.pass.slots * direct_rows(); }

/* Returns the sums of one row of point x. */
DirectSums direct_sums(uint x, uint row)
{
    return DirectSums(direct_sums_at() + DIRECT_SUMS_BYTES * direct_row(x, row));
}
DirectFloats direct_luminance(uint i, uint x, uint row)
{
    return DirectFloats(direct_luminances_at() + 4ul * (direct_rows() * i + direct_row(x, row)));
}
DirectChoices direct_choice(uint i) { return DirectChoices(direct_choices_at() + 8ul * i * push.pass.room); }
DirectWords direct_counts() { return DirectWords(direct_counts_at()); }
/* Samples of a point, whose word of chunk.states is given. */
uint direct_samples(uint state)
{
    return push.pass.samples != 0u ? push.pass.samples : state >> KILN_GPU_STATE_SAMPLES_SHIFT;
}
/* Largest number of clusters in the point's cut. */
uint direct_limit(uint state)
{
    return push.pass.samples != 0u ? push.pass.limit : kiln_cut_limit(direct_samples(state));
}
/* Whether directional lights have pilots (direct_pilot.comp). */
bool direct_has_pilots()
{
    return light_kind(KILN_GPU_KIND_SUN) && light_kind(KILN_GPU_KIND_SKY | KILN_GPU_KIND_IMAGE);
}
/* The rays of a point's pilots, if there are pilots. */
DirectWords direct_pilot_rays() { return DirectWords(direct_counts_at() + 4ul * push.pass.room); }
/* Float `number` of the groups' light, for all rows. */
DirectFloats direct_groups(uint number)
{
    const uint64_t words = uint64_t(push.pass.room) * (direct_has_pilots() ? 2ul : 1ul);
    return DirectFloats(direct_counts_at() + 4ul * (words + direct_rows() * number));
}
/* Finds how a point's samples are divided: into `slices` slices per quarter, and `split` rows per slice. `split_up`:
 * called in the kernel for partly buried points. */
void direct_slices(uint state, bool split_up, out uint slices, out uint split)
{
    slices = push.pass.slices;
    split = push.pass.split;
    if (push.pass.samples != 0u)
        return;
    const uint most = direct_samples(state) * (direct_has_pilots() ? KILN_SUN_TIMES : 1u);
    const kiln_slices s = kiln_slices_of(most, push.pass.software != 0u);
    slices = split_up ? s.per_quarter * s.split : s.per_quarter;
    split = split_up ? 1u : s.split;
}
