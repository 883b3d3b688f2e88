#include "worker/light/lamp_textures.h"

#include <math.h>

#include "shaders/shared/color.h"
#include "worker/base/memory.h"
#include "worker/scene/texture.h"
#include "worker/scene/texture_means.h"

enum { LOOKS_LEAST = 8, LOOKS_MOST = 64 }; /* lookups along a side of a triangle without usable texture means */
/* Assumed opacity where lookups find no light, since they may have missed some. */
static const double UNSEEN = 1.0 / 64.0;

struct kiln_lamp_textures {
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    struct kiln_texture_means **emission, **opacity; /* per material; NULL: it has no such texture */
};

static bool emits(const struct kiln_material *m)
{
    return m->emission[0] > 0.0f || m->emission[1] > 0.0f || m->emission[2] > 0.0f;
}

static bool has_alpha_texture(const struct kiln_material *m)
{
    return m->alpha_mode != KILN_ALPHA_OPAQUE && m->base_color_texture != KILN_NONE;
}

static bool has_transmission_texture(const struct kiln_material *m)
{
    return m->transmission > 0.0f && m->transmission_texture != KILN_NONE;
}

static int create_of_material(struct kiln_lamp_textures *t, uint32_t material, struct kiln_error *error)
{
    const struct kiln_material *m = &t->scene->materials[material];
    int status = KILN_OK;
    if (emits(m) && m->emission_texture != KILN_NONE)
        status = kiln_texture_means_create(
            &t->emission[material], t->scene,
            (struct kiln_texture_look){.texture = m->emission_texture, .alpha_mode = KILN_ALPHA_OPAQUE}, error);
    if (status == KILN_OK && emits(m) && has_alpha_texture(m) && m->base_color[3] > 0.0f)
        status = kiln_texture_means_create(
            &t->opacity[material], t->scene,
            (struct kiln_texture_look){
                .texture = m->base_color_texture,
                .alpha_mode = m->alpha_mode,
                .alpha_cutoff = m->alpha_mode == KILN_ALPHA_MASK ? m->alpha_cutoff / m->base_color[3] : 0.0f},
            error);
    return status;
}

int kiln_lamp_textures_create(struct kiln_lamp_textures **textures, const struct kiln_scene *scene,
                              const struct kiln_geometry *geometry, struct kiln_error *error)
{
    static const char what[] = "the textures of lamps";
    *textures = NULL;
    struct kiln_lamp_textures *t = NULL;
    int status = kiln_allocate(&t, 1, sizeof *t, what, error);
    if (status != KILN_OK)
        return status;
    t->scene = scene;
    t->geometry = geometry;
    KILN_TRY(kiln_allocate(&t->emission, scene->material_count, sizeof *t->emission, what, error));
    KILN_TRY(kiln_allocate(&t->opacity, scene->material_count, sizeof *t->opacity, what, error));
    for (uint32_t i = 0; i < scene->material_count; i++)
        KILN_TRY(create_of_material(t, i, error));
end:
    if (status == KILN_OK)
        *textures = t;
    else
        kiln_lamp_textures_destroy(&t);
    return status;
}

void kiln_lamp_textures_destroy(struct kiln_lamp_textures **textures)
{
    struct kiln_lamp_textures *t = *textures;
    if (t == NULL)
        return;
    for (size_t i = 0; i < t->scene->material_count && t->emission != NULL && t->opacity != NULL; i++) {
        kiln_texture_means_destroy(&t->emission[i]);
        kiln_texture_means_destroy(&t->opacity[i]);
    }
    kiln_free(&t->emission);
    kiln_free(&t->opacity);
    kiln_free(textures);
}

/* ---- a triangle ---- */

struct lamp {
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    const struct kiln_material *material;
    uint32_t index, triangle; /* of the material; in the world */
    uint64_t vertex[3];       /* in the world triangle's order */
    bool see_through;         /* it has opacity */
};

static struct lamp lamp_of(const struct kiln_scene *scene, const struct kiln_geometry *geometry, uint32_t triangle)
{
    struct lamp lamp = {.scene = scene, .geometry = geometry, .triangle = triangle};
    lamp.index = geometry->records[triangle].material & KILN_RECORD_MATERIAL;
    lamp.material = &scene->materials[lamp.index];
    lamp.see_through = triangle >= geometry->opaque_count;
    kiln_geometry_stored_vertices(scene, geometry, triangle, lamp.vertex);
    return lamp;
}

static uint8_t alpha_of(const struct lamp *l, int corner) { return l->scene->colors[4 * l->vertex[corner] + 3]; }

static bool has_even_alpha(const struct lamp *l)
{
    return l->material->alpha_mode == KILN_ALPHA_OPAQUE ||
           (alpha_of(l, 0) == alpha_of(l, 1) && alpha_of(l, 0) == alpha_of(l, 2));
}

bool kiln_lamp_is_uneven(const struct kiln_scene *scene, const struct kiln_geometry *geometry, uint32_t triangle)
{
    const struct lamp l = lamp_of(scene, geometry, triangle);
    return l.material->emission_texture != KILN_NONE ||
           (l.see_through &&
            (has_alpha_texture(l.material) || has_transmission_texture(l.material) || !has_even_alpha(&l)));
}

static void radiance_at(const struct lamp *l, double b1, double b2, float rgb[3])
{
    const struct kiln_object *object = &l->scene->objects[l->geometry->records[l->triangle].object];
    const struct kiln_mesh *mesh = &l->scene->meshes[object->mesh];
    const uint64_t stored = l->geometry->stored_triangle[l->triangle];
    float s1, s2;
    kiln_geometry_stored_barycentrics(l->scene, l->geometry, l->triangle, (float)b1, (float)b2, &s1, &s2);
    kiln_surface_emission(l->scene, mesh, stored, s1, s2, rgb);
    const float opacity = l->see_through ? kiln_surface_opacity(l->scene, mesh, stored, s1, s2) : 1.0f;
    for (int c = 0; c < 3; c++)
        rgb[c] *= opacity;
}

void kiln_lamp_radiance(const struct kiln_scene *scene, const struct kiln_geometry *geometry, uint32_t triangle,
                        double b1, double b2, float rgb[3])
{
    const struct lamp l = lamp_of(scene, geometry, triangle);
    radiance_at(&l, b1, b2, rgb);
}

/* ---- means ---- */

static double luminance(const double rgb[3])
{
    const float slim[3] = {(float)rgb[0], (float)rgb[1], (float)rgb[2]};
    return kiln_luminance_of_floats(slim);
}

/* Averages over n^2 equal triangles within triangle (0, i, i + 1) of the polygon, with the weight `weight`. */
static void look_over(const struct lamp *l, const double (*p)[2], uint32_t i, int n, double weight, double rgb[3],
                      double *square)
{
    for (int a = 0; a < n; a++)
        for (int k = 0; k < 2 * (n - a) - 1; k++) {
            const double upward = k % 2 == 0 ? 1.0 : 2.0, s = (a + upward / 3.0) / n, t = (k / 2 + upward / 3.0) / n;
            float one[3];
            radiance_at(l, p[0][0] + s * (p[i][0] - p[0][0]) + t * (p[i + 1][0] - p[0][0]),
                        p[0][1] + s * (p[i][1] - p[0][1]) + t * (p[i + 1][1] - p[0][1]), one);
            const double light = kiln_luminance_of_floats(one);
            for (int c = 0; c < 3; c++)
                rgb[c] += weight / ((double)n * n) * (double)one[c];
            *square += weight / ((double)n * n) * light * light;
        }
}

/* Number of texels of a texture along the polygon's bounds. */
static double texels_along(const struct lamp *l, uint32_t texture, const struct kiln_vec2 *texcoord,
                           const double (*p)[2], uint32_t corners)
{
    const struct kiln_vec2 a = texcoord[l->vertex[0]], b = texcoord[l->vertex[1]], c = texcoord[l->vertex[2]];
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    if (texture == KILN_NONE)
        return 0.0;
    for (uint32_t i = 0; i < corners; i++) {
        const double u = p[i][0] * (double)(b.x - a.x) + p[i][1] * (double)(c.x - a.x),
                     v = p[i][0] * (double)(b.y - a.y) + p[i][1] * (double)(c.y - a.y);
        low[0] = fmin(low[0], u), high[0] = fmax(high[0], u);
        low[1] = fmin(low[1], v), high[1] = fmax(high[1], v);
    }
    const struct kiln_texture *t = &l->scene->textures[texture];
    return fmax((high[0] - low[0]) * t->width, (high[1] - low[1]) * t->height);
}

static void look_at_all(const struct lamp *l, const double (*p)[2], uint32_t corners, double rgb[3], double *square)
{
    const struct kiln_material *m = l->material;
    const double texels = fmax(texels_along(l, m->emission_texture, l->scene->texcoord_emission, p, corners),
                               fmax(texels_along(l, has_alpha_texture(m) ? m->base_color_texture : KILN_NONE,
                                                 l->scene->texcoord_base, p, corners),
                                    texels_along(l, has_transmission_texture(m) ? m->transmission_texture : KILN_NONE,
                                                 l->scene->texcoord_base, p, corners)));
    const int n = (int)fmin(fmax(4.0 * texels, LOOKS_LEAST), LOOKS_MOST);
    double whole = 0.0;
    for (int pass = 0; pass < 2; pass++) /* first the sum of the areas, then shares of it */
        for (uint32_t i = 1; i + 1 < corners; i++) {
            const double area =
                fabs((p[i][0] - p[0][0]) * (p[i + 1][1] - p[0][1]) - (p[i + 1][0] - p[0][0]) * (p[i][1] - p[0][1]));
            if (pass == 0)
                whole += area;
            else if (area > 0.0)
                look_over(l, p, i, n, area / whole, rgb, square);
        }
}

/* Finds the factor of the opacity that is constant over the triangle. False: the rest is not just the alpha texture. */
static bool even_opacity(const struct lamp *l, double *opacity)
{
    const struct kiln_material *m = l->material;
    *opacity = 1.0;
    if (!l->see_through)
        return true;
    if (has_transmission_texture(m) || !has_even_alpha(l) ||
        (m->alpha_mode == KILN_ALPHA_MASK && has_alpha_texture(m) && alpha_of(l, 0) != 255))
        return false;
    const float alpha = m->base_color[3] * (float)alpha_of(l, 0) / 255.0f;
    const float covered = has_alpha_texture(m) && m->alpha_mode == KILN_ALPHA_MASK
                              ? 1.0f
                              : kiln_coverage(m->alpha_mode, m->alpha_cutoff, fminf(fmaxf(alpha, 0.0f), 1.0f));
    *opacity = (double)(covered * (1.0f - m->transmission));
    return true;
}

static void places_of(const struct lamp *l, const struct kiln_vec2 *texcoord, double uv[3][2])
{
    for (int k = 0; k < 3; k++) {
        uv[k][0] = (double)texcoord[l->vertex[k]].x;
        uv[k][1] = (double)texcoord[l->vertex[k]].y;
    }
}

static double twice_texels(const struct kiln_scene *scene, uint32_t texture, const double uv[3][2])
{
    const struct kiln_texture *t = &scene->textures[texture];
    return fabs((uv[1][0] - uv[0][0]) * (uv[2][1] - uv[0][1]) - (uv[2][0] - uv[0][0]) * (uv[1][1] - uv[0][1])) *
           t->width * t->height;
}

/* Averages by texture means: over cells of the finer texture, with the other one at the cells' middles. */
static bool mean_of_textures(const struct lamp *l, const struct kiln_texture_means *emission,
                             const struct kiln_texture_means *opacity, double even, const double (*p)[2],
                             uint32_t corners, uint32_t most, struct kiln_texture_mean *mean)
{
    const struct kiln_material *m = l->material;
    double of_emission[3][2], of_opacity[3][2], polygon[KILN_TEXTURE_POLYGON][2];
    places_of(l, l->scene->texcoord_emission, of_emission);
    places_of(l, l->scene->texcoord_base, of_opacity);
    const bool both = emission != NULL && opacity != NULL,
               first = emission != NULL && (!both || twice_texels(l->scene, m->emission_texture, of_emission) >=
                                                         twice_texels(l->scene, m->base_color_texture, of_opacity));
    double(*const uv)[2] = first ? of_emission : of_opacity, (*const others)[2] = first ? of_opacity : of_emission;
    struct kiln_texture_factor factor = {.by_coverage = !first, .by_other_coverage = first};
    for (int c = 0; c < 3; c++)
        factor.value[c][0] = (double)m->emission[c] * even;
    factor.value[3][0] = 1.0;
    factor.other = !both ? NULL : first ? opacity : emission;
    for (int k = 0; k < 2 && both; k++) {
        const double at[3] = {others[0][k], others[1][k], others[2][k]};
        if (!kiln_texture_linear((const double(*)[2])uv, at, factor.at[k]))
            return false;
    }
    for (uint32_t i = 0; i < corners; i++)
        for (int k = 0; k < 2; k++)
            polygon[i][k] = uv[0][k] + p[i][0] * (uv[1][k] - uv[0][k]) + p[i][1] * (uv[2][k] - uv[0][k]);
    return kiln_texture_means_over(first ? emission : opacity, (const double(*)[2])polygon, corners, most, &factor,
                                   mean);
}

void kiln_lamp_mean(const struct kiln_lamp_textures *t, uint32_t triangle, const double (*p)[2], uint32_t corners,
                    uint32_t most, double rgb[3], double *square)
{
    const struct lamp l = lamp_of(t->scene, t->geometry, triangle);
    const struct kiln_texture_means *emission = t->emission[l.index],
                                    *opacity = l.see_through ? t->opacity[l.index] : NULL;
    struct kiln_texture_mean mean;
    double even;
    const bool told = even_opacity(&l, &even);
    rgb[0] = rgb[1] = rgb[2] = *square = 0.0;
    if (told && emission == NULL && opacity == NULL) {
        for (int c = 0; c < 3; c++)
            rgb[c] = (double)l.material->emission[c] * even;
        *square = luminance(rgb) * luminance(rgb);
    } else if (told && mean_of_textures(&l, emission, opacity, even, p, corners, most, &mean)) {
        for (int c = 0; c < 3; c++)
            rgb[c] = mean.value[c];
        *square = mean.square;
    } else {
        look_at_all(&l, p, corners, rgb, square);
        if (!(luminance(rgb) > 0.0) && l.see_through && even > 0.0 &&
            (emission == NULL || mean_of_textures(&l, emission, NULL, UNSEEN, p, corners, most, &mean)))
            for (int c = 0; c < 3; c++)
                rgb[c] = emission == NULL ? UNSEEN * (double)l.material->emission[c] : mean.value[c];
    }
}
