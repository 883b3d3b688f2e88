/* The group of lights that a sample belongs to: worker/light/light_groups.h. Needs shaders/lights.glsl. */
#include "shaders/shared/sky_patch.h"

/* Floats of a group's light: incident light, and irradiance if it differs. */
const uint GROUP_FLOATS = HAS_SMOOTH != 0u ? 6u : 3u;

KILN_ARRAY(GroupWords, uint, 4);
KILN_ARRAY(GroupBlocks, kiln_gpu_light_block, 4);
layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer GroupsRef { kiln_gpu_light_groups value; };

/* Index of the block that contains `at`, in a row of `count` blocks. */
uint block_of(real at, uint count) { return at > 0 ? uint(min(at, real(count - 1u))) : 0u; }

/* kiln_light_block */
uint light_block(kiln_gpu_light_block b, uint light, real3 place)
{
    const kiln_gpu_area_light area = AreaLights(SCENE.lights.areas).at[light];
    real b1, b2;
    kiln_triangle_weights(real3_of(area.e1), real3_of(area.e2), real3(stored3(place) - stored3_of(area.p0)), b1, b2);
    return block_of(real(b.at[1]) + b1 * real(b.along1[1]) + b2 * real(b.along2[1]), b.rows) * b.columns +
           block_of(real(b.at[0]) + b1 * real(b.along1[0]) + b2 * real(b.along2[0]), b.columns);
}

/* kiln_light_group, for a sample that was drawn at `place`. */
uint light_group(uint kind, uint index, kiln_light_sample s, real3 place)
{
    const kiln_gpu_light_groups g = GroupsRef(SCENE.lights.groups).value;
    if (kind == KILN_CHOICE_ENVIRONMENT)
        return g.of_environment + (g.sky_divisions > 0u ? kiln_sky_patch(s.direction, g.sky_divisions) : 0u);
    if (kind == KILN_CHOICE_DIRECTIONAL)
        return GroupWords(g.of_directional).at[index];
    const uint group = GroupWords(g.of_tree).at[s.light];
    if (s.light >= SCENE.lights.area_count || GroupBlocks(g.blocks).at[s.light].columns == 0u)
        return group;
    return group + light_block(GroupBlocks(g.blocks).at[s.light], s.light, place + s.direction * s.distance);
}
