/* Alpha and emission of surfaces, with the formulas and filters of worker/scene/texture.c.
 *
 * For world triangles that have a coating (see shared/layout_material.h): those that may let rays through, and those
 * whose emission has a texture. (u, v) are the world triangle's barycentrics, as tracing returns them. */
#ifndef KILN_SHADERS_MATERIAL_GLSL
#define KILN_SHADERS_MATERIAL_GLSL

KILN_ARRAY(MaterialArray, kiln_gpu_material, 4);
KILN_ARRAY(TextureArray, kiln_gpu_texture, 8);
KILN_ARRAY(CoatingArray, kiln_gpu_coating, 4);
KILN_ARRAY(MaterialWords, uint, 4);
KILN_ARRAY(MaterialFloats, float, 4);

const uint kiln_texel_fraction = 45u; /* binary digits of a texel coordinate: 2 periods of 2^16 texels fit into 63 */

/* Texel coordinate of a texture coordinate in fixed point: exact to 2^-45 of a period without doubles. Wrapping has a
 * period of two, so subtracting multiples of two is exact. */
int64_t kiln_texel_coordinate(float u, uint size, uint wrap)
{
    const float near = wrap == KILN_WRAP_CLAMP ? clamp(u, -1.0, 2.0) : u - 2.0 * trunc(0.5 * u);
    return int64_t(near * 35184372088832.0 /* 2^45 */) * int64_t(size);
}

/* The texels that `at` and `at` + 1 stand for. Integer division is long code on GPUs, so both take one. */
uvec2 kiln_wrapped(int at, uint size, uint wrap)
{
    const int n = int(size);
    if (wrap == KILN_WRAP_CLAMP)
        return uvec2(clamp(ivec2(at, at + 1), 0, n - 1));
    const int period = wrap == KILN_WRAP_MIRROR ? 2 * n : n;
    const int below = at - (at / period) * period, m = below < 0 ? below + period : below;
    const int next = m + 1 < period ? m + 1 : 0;
    return uvec2(m < n ? m : period - 1 - m, next < n ? next : period - 1 - next);
}

/* The 2 x 2 texels of a bilinear filter: two columns, two rows, and the position between them. With `nearest` only the
 * first column and row are used. */
struct kiln_texel_cell {
    uvec2 x, y;
    float fx, fy;
};

kiln_texel_cell kiln_texel_cell_of(kiln_gpu_texture t, vec2 at)
{
    const int64_t shift =
        t.nearest != 0u ? 0l : 1l << (kiln_texel_fraction - 1u); /* a bilinear cell begins at a texel's centre */
    const int64_t x = kiln_texel_coordinate(at.x, t.width, t.wrap_u) - shift,
                  y = kiln_texel_coordinate(at.y, t.height, t.wrap_v) - shift;
    const int left = int(x >> kiln_texel_fraction), top = int(y >> kiln_texel_fraction);
    kiln_texel_cell cell;
    cell.x = kiln_wrapped(left, t.width, t.wrap_u);
    cell.y = kiln_wrapped(top, t.height, t.wrap_v);
    cell.fx = float(uint(x >> (kiln_texel_fraction - 32u))) / 4294967296.0;
    cell.fy = float(uint(y >> (kiln_texel_fraction - 32u))) / 4294967296.0;
    return cell;
}

uint kiln_texel(kiln_gpu_texture t, uint x, uint y)
{
    return MaterialWords(t.texels + 4ul * (uint64_t(y) * t.width + x)).at[0];
}

vec4 kiln_texel_color(kiln_gpu_texture t, uint x, uint y)
{
    const uint code = kiln_texel(t, x, y);
    const uvec4 channel = uvec4(code, code >> 8, code >> 16, code >> 24) & 255u;
    if (t.srgb == 0u)
        return vec4(channel) / 255.0;
    MaterialFloats linear = MaterialFloats(SCENE.materials.linear_of_srgb);
    return vec4(linear.at[channel.r], linear.at[channel.g], linear.at[channel.b], float(channel.a) / 255.0);
}

/* Linear RGBA, filtered and wrapped as the texture says. A loop over the texels, so that their code exists once. */
vec4 kiln_texture_sample(uint index, vec2 at)
{
    const kiln_gpu_texture t = TextureArray(SCENE.materials.textures).at[index];
    const kiln_texel_cell cell = kiln_texel_cell_of(t, at);
    const uint count = t.nearest != 0u ? 1u : 4u;
    vec4 left = vec4(0.0), upper = vec4(0.0), lower = vec4(0.0);
    for (uint i = 0u; i < count; i++) {
        const bool is_left = (i & 1u) == 0u;
        const vec4 texel = kiln_texel_color(t, is_left ? cell.x.x : cell.x.y, i < 2u ? cell.y.x : cell.y.y);
        upper = is_left ? upper : lower;
        lower = is_left ? lower : left + cell.fx * (texel - left);
        left = is_left ? texel : left;
    }
    return t.nearest != 0u ? left : upper + cell.fy * (lower - upper);
}

/* Index of a world triangle's coating, with KILN_GPU_FLIPPED. */
uint kiln_slot_of(uint triangle)
{
    return MaterialWords(SCENE.materials.slots + 4ul * (triangle - SCENE.materials.slot_first)).at[0];
}

/* The coating of a world triangle; converts its barycentrics to those of the stored triangle. */
kiln_gpu_coating kiln_coating_of(uint triangle, inout float u, inout float v)
{
    const uint slot = kiln_slot_of(triangle);
    if ((slot & KILN_GPU_FLIPPED) != 0u) {
        const float other = u;
        u = v;
        v = other;
    }
    return CoatingArray(SCENE.materials.coatings + 64ul * (slot & ~KILN_GPU_FLIPPED)).at[0];
}

vec2 kiln_interpolated(float value[6], float b1, float b2)
{
    const vec2 a = vec2(value[0], value[1]), b = vec2(value[2], value[3]), c = vec2(value[4], value[5]);
    return a + b1 * (b - a) + b2 * (c - a);
}

/* The material of any triangle, by the index in its record (KILN_RECORD_MATERIAL). */
kiln_gpu_material kiln_material_of(uint material) { return MaterialArray(SCENE.materials.materials).at[material]; }

float kiln_texel_alpha(kiln_gpu_texture t, uint x, uint y) { return float(kiln_texel(t, x, y) >> 24) / 255.0; }

/* Only the last channel of kiln_texture_sample. */
float kiln_texture_alpha(uint index, vec2 at)
{
    const kiln_gpu_texture t = TextureArray(SCENE.materials.textures).at[index];
    const kiln_texel_cell cell = kiln_texel_cell_of(t, at);
    const float first = kiln_texel_alpha(t, cell.x.x, cell.y.x);
    if (t.nearest != 0u)
        return first;
    const float upper = first + cell.fx * (kiln_texel_alpha(t, cell.x.y, cell.y.x) - first);
    const float third = kiln_texel_alpha(t, cell.x.x, cell.y.y),
                lower = third + cell.fx * (kiln_texel_alpha(t, cell.x.y, cell.y.y) - third);
    return upper + cell.fy * (lower - upper);
}

vec4 kiln_vertex_color(uint code) { return vec4(uvec4(code, code >> 8, code >> 16, code >> 24) & 255u) / 255.0; }

/* Only alpha, and the cutoff of a mask (-1: blended). */
vec2 kiln_surface_alpha(uint triangle, float u, float v)
{
    const kiln_gpu_coating coating = kiln_coating_of(triangle, u, v);
    const kiln_gpu_material m = kiln_material_of(coating.material);
    float alpha = ((1.0 - u - v) * float(coating.colors[0] >> 24) + u * float(coating.colors[1] >> 24) +
                   v * float(coating.colors[2] >> 24)) /
                  255.0;
    alpha *= m.base_alpha;
    if ((TEXTURED & KILN_TEXTURED_PASSAGE) != 0u && m.base_color_texture != KILN_GPU_NONE)
        alpha *= kiln_texture_alpha(m.base_color_texture, kiln_interpolated(coating.base, u, v));
    return vec2(clamp(alpha, 0.0, 1.0), m.alpha_mode == KILN_ALPHA_MASK ? m.alpha_cutoff : -1.0);
}

/* struct kiln_passage of worker/scene/texture.h; without colours unless HAS_ALPHA says that there are any. */
struct kiln_passage {
    float opacity;
    vec3 through;
};

/* Absolute cosine between a unit direction and the normal of a triangle that is not opaque; 1 where nothing depends on
 * it. */
float kiln_passage_cosine(uint triangle, vec3 direction)
{
    if (HAS_ALPHA < KILN_PASSAGE_PANE)
        return 1.0;
    MaterialFloats of = MaterialFloats(SCENE.materials.normals + uint64_t(triangle - SCENE.opaque_count) * 12ul);
    const vec3 normal = vec3(of.at[0], of.at[1], of.at[2]);
    return min(abs(dot(normal, direction)), 1.0);
}

kiln_passage kiln_surface_passage(uint triangle, float u, float v, float cosine)
{
    const kiln_gpu_coating coating = kiln_coating_of(triangle, u, v);
    const kiln_gpu_material m = kiln_material_of(coating.material);
    const vec2 at = kiln_interpolated(coating.base, u, v);
    vec4 color = ((1.0 - u - v) * kiln_vertex_color(coating.colors[0]) + u * kiln_vertex_color(coating.colors[1]) +
                  v * kiln_vertex_color(coating.colors[2])) *
                 vec4(m.base_color[0], m.base_color[1], m.base_color[2], m.base_alpha);
    const bool textured = (TEXTURED & KILN_TEXTURED_PASSAGE) != 0u && m.base_color_texture != KILN_GPU_NONE;
    if (textured && (HAS_ALPHA >= KILN_PASSAGE_TINT && m.transmission > 0.0))
        color *= kiln_texture_sample(m.base_color_texture, at);
    else if (textured)
        color.a *= kiln_texture_alpha(m.base_color_texture, at);
    color = clamp(color, 0.0, 1.0);
    const float covered = kiln_coverage(m.alpha_mode, m.alpha_cutoff, color.a);
    if (HAS_ALPHA < KILN_PASSAGE_TINT || m.transmission == 0.0)
        return kiln_passage(covered, vec3(1.0 - covered));
    float let = covered * m.transmission;
    if ((TEXTURED & KILN_TEXTURED_PASSAGE) != 0u && m.transmission_texture != KILN_GPU_NONE)
        let *= kiln_texture_sample(m.transmission_texture, at).r;
    const float opacity = covered - let;
    if (HAS_ALPHA >= KILN_PASSAGE_PANE)
        let *= kiln_pane_share(m.pane, cosine);
    return kiln_passage(opacity, (1.0 - covered) + let * color.rgb);
}

/* For the opacity alone. */
kiln_passage kiln_surface_passage(uint triangle, float u, float v) { return kiln_surface_passage(triangle, u, v, 1.0); }

/* Base colour x vertex colour x texture. `seen`: with a metal's own colour; as an albedo a metal's is 0. */
vec3 kiln_surface_color(uint triangle, float u, float v, bool seen)
{
    const kiln_gpu_coating coating = kiln_coating_of(triangle, u, v);
    const kiln_gpu_material m = kiln_material_of(coating.material);
    const vec3 factor = seen ? vec3(m.seen_color[0], m.seen_color[1], m.seen_color[2])
                             : vec3(m.base_color[0], m.base_color[1], m.base_color[2]);
    vec3 color = factor * ((1.0 - u - v) * kiln_vertex_color(coating.colors[0]) +
                           u * kiln_vertex_color(coating.colors[1]) + v * kiln_vertex_color(coating.colors[2]))
                              .rgb;
    if ((TEXTURED & KILN_TEXTURED_COLOR) != 0u && m.base_color_texture != KILN_GPU_NONE)
        color *= kiln_texture_sample(m.base_color_texture, kiln_interpolated(coating.base, u, v)).rgb;
    return clamp(color, 0.0, 1.0);
}

/* Emitted radiance, W m-2 sr-1. */
vec3 kiln_surface_emission(uint triangle, float u, float v)
{
    const kiln_gpu_coating coating = kiln_coating_of(triangle, u, v);
    const kiln_gpu_material m = kiln_material_of(coating.material);
    const vec3 emission = vec3(m.emission[0], m.emission[1], m.emission[2]);
    if ((TEXTURED & KILN_TEXTURED_EMISSION) == 0u || m.emission_texture == KILN_GPU_NONE)
        return emission;
    return emission * kiln_texture_sample(m.emission_texture, kiln_interpolated(coating.emission, u, v)).rgb;
}

#endif
