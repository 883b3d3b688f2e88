/* Additions to gather.glsl for a set of directions (worker/pass/directions.h). Sample k uses direction k of the set,
 * rotated by a random angle of the point, with the weight from the set. Radiosity is any packed one, times a scale.
 * push.set: quads; the first has the scale and whether there is a set, the others radius, angle and weight of a
 * direction. set_sample is the ray's number. */
layout(buffer_reference, scalar, buffer_reference_align = 16) readonly buffer SetQuads { vec4 at[]; };

float set_turn, set_weight, set_scale; /* the point's angle; the ray's weight; scale of all radiosity */
bool set_is_there;

void set_begin(uint key)
{
    const vec4 head = SetQuads(push.set).at[0];
    set_scale = head.x;
    set_is_there = head.y > 0.0;
    set_turn = kiln_unit_float(kiln_gather_shift(kiln_hash2(key, push.hemisphere.stream), KILN_DIMENSION_V));
}

vec3 set_direction(vec3 axis, float u, float v, out float cosine)
{
    set_weight = 1.0;
    if (!set_is_there)
        return hemisphere_cosine(axis, u, v, cosine);
    const vec4 to = SetQuads(push.set).at[set_sample + 1u];
    const float turn = to.y + set_turn;
    cosine = sqrt(1.0 - to.x * to.x);
    set_weight = to.z;
    return hemisphere_direction(axis, to.x, cosine, turn < 1.0 ? turn : turn - 1.0);
}
