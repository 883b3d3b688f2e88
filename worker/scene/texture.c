#include "worker/scene/texture.h"

#include <assert.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

/* Beyond this many filter cells in one triangle, the mean is taken over a regular lattice of samples instead: a texture
 * repeated that often under one triangle averages out. */
static const double cells_max = 1 << 20;
enum { LATTICE = 1024, LINE_SAMPLES_MAX = 512 };

/* Linear value of each sRGB code: c / 12.92 up to 0.04045, else ((c + 0.055) / 1.055)^2.4 (IEC 61966-2-1). */
static const float linear_of_srgb[256] = {
    0.0f,           0.000303526991f, 0.000607053982f, 0.000910580973f, 0.00121410796f,
    0.00151763496f, 0.00182116195f,  0.00212468882f,  0.00242821593f,  0.0027317428f,
    0.00303526991f, 0.00334653584f,  0.00367650739f,  0.00402471703f,  0.00439144205f,
    0.00477695325f, 0.00518151652f,  0.00560539169f,  0.00604883302f,  0.00651209056f,
    0.00699541019f, 0.00749903219f,  0.00802319311f,  0.00856812578f,  0.00913405884f,
    0.00972121768f, 0.010329823f,    0.0109600937f,   0.0116122449f,   0.012286488f,
    0.0129830325f,  0.0137020834f,   0.0144438436f,   0.0152085144f,   0.0159962941f,
    0.0168073755f,  0.0176419541f,   0.01850022f,     0.0193823613f,   0.0202885624f,
    0.0212190095f,  0.0221738853f,   0.0231533665f,   0.0241576321f,   0.0251868591f,
    0.0262412224f,  0.0273208916f,   0.02842604f,     0.0295568351f,   0.0307134446f,
    0.0318960324f,  0.0331047662f,   0.0343398079f,   0.0356013142f,   0.0368894488f,
    0.0382043719f,  0.0395462364f,   0.0409151986f,   0.0423114114f,   0.043735031f,
    0.045186203f,   0.0466650873f,   0.0481718257f,   0.0497065671f,   0.0512694567f,
    0.0528606474f,  0.054480277f,    0.0561284907f,   0.0578054301f,   0.0595112368f,
    0.0612460524f,  0.0630100146f,   0.064803265f,    0.0666259378f,   0.0684781671f,
    0.0703600943f,  0.0722718537f,   0.0742135718f,   0.0761853829f,   0.078187421f,
    0.0802198201f,  0.0822827071f,   0.0843762085f,   0.0865004584f,   0.0886555836f,
    0.0908417106f,  0.0930589661f,   0.0953074694f,   0.097587347f,    0.0998987257f,
    0.102241732f,   0.104616486f,    0.107023105f,    0.10946171f,     0.111932427f,
    0.114435375f,   0.116970666f,    0.119538426f,    0.122138776f,    0.124771819f,
    0.127437681f,   0.130136475f,    0.13286832f,     0.135633335f,    0.138431609f,
    0.141263291f,   0.144128472f,    0.147027269f,    0.149959788f,    0.152926147f,
    0.155926466f,   0.158960834f,    0.162029371f,    0.165132195f,    0.168269396f,
    0.171441108f,   0.174647406f,    0.177888423f,    0.18116425f,     0.18447499f,
    0.187820777f,   0.191201687f,    0.194617838f,    0.198069319f,    0.20155625f,
    0.205078736f,   0.208636865f,    0.212230757f,    0.215860501f,    0.219526201f,
    0.223227963f,   0.226965874f,    0.230740055f,    0.23455058f,     0.238397568f,
    0.242281124f,   0.246201321f,    0.25015828f,     0.254152089f,    0.258182853f,
    0.262250662f,   0.266355604f,    0.270497799f,    0.274677306f,    0.278894275f,
    0.283148736f,   0.287440836f,    0.291770637f,    0.296138257f,    0.300543785f,
    0.304987311f,   0.309468925f,    0.313988715f,    0.318546772f,    0.323143214f,
    0.327778101f,   0.332451522f,    0.337163627f,    0.341914415f,    0.346704066f,
    0.351532608f,   0.356400132f,    0.361306787f,    0.366252601f,    0.371237695f,
    0.376262128f,   0.38132602f,     0.386429429f,    0.391572475f,    0.396755219f,
    0.401977777f,   0.407240212f,    0.412542611f,    0.417885065f,    0.423267663f,
    0.428690493f,   0.434153646f,    0.439657182f,    0.445201188f,    0.450785786f,
    0.456411034f,   0.462076992f,    0.467783809f,    0.473531485f,    0.479320168f,
    0.48514995f,    0.491020858f,    0.496932983f,    0.502886474f,    0.50888133f,
    0.514917672f,   0.520995557f,    0.527115107f,    0.533276379f,    0.539479494f,
    0.545724452f,   0.55201143f,     0.558340371f,    0.564711511f,    0.571124852f,
    0.577580452f,   0.584078431f,    0.590618849f,    0.597201765f,    0.603827357f,
    0.610495567f,   0.617206573f,    0.623960376f,    0.630757153f,    0.637596846f,
    0.644479692f,   0.651405632f,    0.658374846f,    0.665387273f,    0.672443151f,
    0.679542482f,   0.686685324f,    0.693871737f,    0.701101899f,    0.708375752f,
    0.715693474f,   0.723055124f,    0.730460763f,    0.73791039f,     0.745404184f,
    0.752942204f,   0.760524511f,    0.768151164f,    0.775822222f,    0.783537805f,
    0.791297913f,   0.799102724f,    0.806952238f,    0.814846575f,    0.822785735f,
    0.830769897f,   0.838799f,       0.846873224f,    0.854992628f,    0.863157213f,
    0.871367097f,   0.8796224f,      0.887923121f,    0.896269381f,    0.904661179f,
    0.913098633f,   0.921581864f,    0.930110872f,    0.938685715f,    0.947306514f,
    0.955973327f,   0.964686275f,    0.973445296f,    0.982250571f,    0.991102099f,
    1.0f,
};

void kiln_texture_codes(float linear[256]) { memcpy(linear, linear_of_srgb, sizeof linear_of_srgb); }

/* RGBA in a SIMD vector. Each operation gives the same bits as with single floats. */
typedef float colors __attribute__((vector_size(16)));
typedef int32_t words __attribute__((vector_size(16)));
#define ALL(value) ((colors){(value), (value), (value), (value)})

/* Texel column or row for any integer, by the wrap mode. `size` is at most 65536; `at` is any value that fits. */
static inline uint32_t wrapped(int64_t at, uint32_t size, uint32_t wrap)
{
    const int64_t n = size;
    if (at >= 0 && at < n)
        return (uint32_t)at;
    switch (wrap) {
    case KILN_WRAP_CLAMP:
        return (uint32_t)(at < 0 ? 0 : at >= n ? n - 1 : at);
    case KILN_WRAP_MIRROR: {
        int64_t m = at % (2 * n);
        m = m < 0 ? m + 2 * n : m;
        return (uint32_t)(m < n ? m : 2 * n - 1 - m);
    }
    default: {
        if ((size & (size - 1)) == 0)
            return (uint32_t)at & (size - 1);
        const int64_t m = at % n;
        return (uint32_t)(m < 0 ? m + n : m);
    }
    }
}

static inline colors colors_of(const uint8_t code[4])
{
    return (colors){(float)code[0], (float)code[1], (float)code[2], (float)code[3]};
}

static inline colors texel_of(const struct kiln_texture *t, const uint8_t code[4])
{
    if (!t->srgb)
        return colors_of(code) / ALL(255.0f);
    return (colors){linear_of_srgb[code[0]], linear_of_srgb[code[1]], linear_of_srgb[code[2]], (float)code[3] / 255.0f};
}

/* Texel coordinate of a texture coordinate, in double so that it keeps its fraction, and within the range of int64_t.
 * Coordinates that differ by a period are equal after wrapping, so far-away ones are first moved near. */
static double texel_coordinate(float u, uint32_t size, uint32_t wrap)
{
    double x = (double)u;
    if (wrap == KILN_WRAP_CLAMP)
        x = fmin(fmax(x, -1.0), 2.0);
    else if (fabs(x) > 1e6)
        x = fmod(x, 2.0);
    return x * (double)size;
}

/* floor without a call, for values in range. */
static inline int64_t floor_of(double x)
{
    const int64_t whole = (int64_t)x;
    return whole - (x < (double)whole ? 1 : 0);
}

/* The texels that a lookup reads, 4 bytes each, and the position between them. */
struct lookup {
    const uint8_t *corner[4];
    float fx, fy;
};

static inline const uint8_t *texel_at(const struct kiln_scene *scene, const struct kiln_texture *t, uint32_t x,
                                      uint32_t y)
{
    return scene->texels + t->first + 4 * ((uint64_t)y * t->width + x);
}

static inline void place_lookup(const struct kiln_scene *scene, const struct kiln_texture *t, float u, float v,
                                struct lookup *l)
{
    const double x = texel_coordinate(u, t->width, t->wrap_u), y = texel_coordinate(v, t->height, t->wrap_v);
    if (t->nearest) {
        l->corner[0] =
            texel_at(scene, t, wrapped(floor_of(x), t->width, t->wrap_u), wrapped(floor_of(y), t->height, t->wrap_v));
        return;
    }
    const int64_t left = floor_of(x - 0.5), top = floor_of(y - 0.5);
    l->fx = (float)(x - 0.5 - (double)left);
    l->fy = (float)(y - 0.5 - (double)top);
    const uint32_t column[2] = {wrapped(left, t->width, t->wrap_u), wrapped(left + 1, t->width, t->wrap_u)},
                   row[2] = {wrapped(top, t->height, t->wrap_v), wrapped(top + 1, t->height, t->wrap_v)};
    for (int k = 0; k < 4; k++)
        l->corner[k] = texel_at(scene, t, column[k & 1], row[k >> 1]);
}

static inline colors look_up(const struct kiln_texture *t, const struct lookup *l)
{
    if (t->nearest)
        return texel_of(t, l->corner[0]);
    const colors corner[4] = {texel_of(t, l->corner[0]), texel_of(t, l->corner[1]), texel_of(t, l->corner[2]),
                              texel_of(t, l->corner[3])};
    const colors upper = corner[0] + ALL(l->fx) * (corner[1] - corner[0]),
                 lower = corner[2] + ALL(l->fx) * (corner[3] - corner[2]);
    return upper + ALL(l->fy) * (lower - upper);
}

void kiln_texture_sample(const struct kiln_scene *scene, uint32_t index, float u, float v, float rgba[4])
{
    assert(index < scene->texture_count);
    struct lookup l;
    place_lookup(scene, &scene->textures[index], u, v, &l);
    const colors found = look_up(&scene->textures[index], &l);
    memcpy(rgba, &found, sizeof found);
}

/* One channel of kiln_texture_sample. */
static float texture_channel(const struct kiln_scene *scene, uint32_t index, struct kiln_vec2 uv, int channel)
{
    const struct kiln_texture *t = &scene->textures[index];
    const double x = texel_coordinate(uv.x, t->width, t->wrap_u), y = texel_coordinate(uv.y, t->height, t->wrap_v);
    const double shift = t->nearest ? 0.0 : 0.5;
    const int64_t left = floor_of(x - shift), top = floor_of(y - shift);
    const uint64_t row[2] = {wrapped(top, t->height, t->wrap_v), wrapped(top + 1, t->height, t->wrap_v)},
                   column[2] = {wrapped(left, t->width, t->wrap_u), wrapped(left + 1, t->width, t->wrap_u)};
    float corner[4] = {0};
    for (int k = 0; k < (t->nearest ? 1 : 4); k++) {
        const uint8_t code = scene->texels[t->first + 4 * (row[k >> 1] * t->width + column[k & 1]) + (uint64_t)channel];
        corner[k] = t->srgb && channel < 3 ? linear_of_srgb[code] : (float)code / 255.0f;
    }
    if (t->nearest)
        return corner[0];
    const float fx = (float)(x - 0.5 - (double)left), fy = (float)(y - 0.5 - (double)top);
    const float upper = corner[0] + fx * (corner[1] - corner[0]), lower = corner[2] + fx * (corner[3] - corner[2]);
    return upper + fy * (lower - upper);
}

static const uint32_t *corners_of(const struct kiln_scene *scene, uint64_t triangle)
{
    return scene->triangles + 3 * triangle;
}

static struct kiln_vec2 interpolated(const struct kiln_vec2 *values, const uint32_t *corner, float b1, float b2)
{
    const struct kiln_vec2 a = values[corner[0]], b = values[corner[1]], c = values[corner[2]];
    return (struct kiln_vec2){a.x + b1 * (b.x - a.x) + b2 * (c.x - a.x), a.y + b1 * (b.y - a.y) + b2 * (c.y - a.y)};
}

/* Prepares painting a triangle. `kept`: factor on the colour, not on alpha. */
static inline void prepare(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float kept,
                           struct kiln_paint *paint)
{
    const struct kiln_material *m = &scene->materials[scene->triangle_materials[triangle]];
    const uint32_t *corner = corners_of(scene, triangle);
    *paint = (struct kiln_paint){.scene = scene, .texture = m->base_color_texture, .kept = {kept, kept, kept, 1.0f}};
    memcpy(paint->factor, m->base_color, sizeof paint->factor);
    for (int c = 0; c < 3; c++) {
        const colors vertex = colors_of(scene->colors + 4 * (mesh->vertex_first + corner[c]));
        memcpy(paint->vertex[c], &vertex, sizeof vertex);
        if (paint->texture != KILN_NONE)
            paint->at[c] = scene->texcoord_base[mesh->vertex_first + corner[c]];
    }
}

static inline colors load(const float from[4])
{
    colors all;
    memcpy(&all, from, sizeof all);
    return all;
}

/* Base colour x vertex colour x texture. */
static inline void paint_one(const struct kiln_paint *p, float b1, float b2, colors texture, float rgba[4])
{
    const colors vertex =
        (ALL(1.0f - b1 - b2) * load(p->vertex[0]) + ALL(b1) * load(p->vertex[1]) + ALL(b2) * load(p->vertex[2])) /
        ALL(255.0f);
    colors color = load(p->factor) * vertex;
    if (p->texture != KILN_NONE)
        color *= texture;
    color *= load(p->kept);
    color = (colors)((words)color & (color > ALL(0.0f)));
    const words below = color < ALL(1.0f); /* rounding of the weights may step outside by a bit */
    color = (colors)(((words)color & below) | ((words)ALL(1.0f) & ~below));
    memcpy(rgba, &color, sizeof color);
}

/* Finds the texel addresses of all positions first, so that memory accesses overlap. */
static inline void paint_some(const struct kiln_paint *p, const float *b1, const float *b2, int count, float (*rgba)[4])
{
    static const uint32_t corner[3] = {0, 1, 2};
    const struct kiln_texture *t = &p->scene->textures[p->texture != KILN_NONE ? p->texture : 0];
    struct lookup lookups[KILN_PAINT_MOST];
    for (int i = 0; i < count && p->texture != KILN_NONE; i++) {
        const struct kiln_vec2 uv = interpolated(p->at, corner, b1[i], b2[i]);
        place_lookup(p->scene, t, uv.x, uv.y, &lookups[i]);
    }
    for (int i = 0; i < count; i++)
        paint_one(p, b1[i], b2[i], p->texture != KILN_NONE ? look_up(t, &lookups[i]) : ALL(1.0f), rgba[i]);
}

static void surface_color(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1,
                          float b2, float kept, float rgba[4])
{
    struct kiln_paint paint;
    prepare(scene, mesh, triangle, kept, &paint);
    paint_some(&paint, &b1, &b2, 1, (float(*)[4])rgba);
}

/* Fraction of a material's surface that exists at a position, by its alpha. */
static float coverage(const struct kiln_material *m, float alpha)
{
    return kiln_coverage(m->alpha_mode, m->alpha_cutoff, alpha);
}

static float transmission_at(const struct kiln_scene *scene, const struct kiln_material *m, struct kiln_vec2 uv)
{
    if (!(m->transmission > 0.0f) || m->transmission_texture == KILN_NONE)
        return m->transmission;
    return m->transmission * texture_channel(scene, m->transmission_texture, uv, 0);
}

void kiln_surface_passage(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1,
                          float b2, float cosine, struct kiln_passage *passage)
{
    const uint32_t material = scene->triangle_materials[triangle];
    const struct kiln_material *m = &scene->materials[material];
    float rgba[4];
    kiln_surface_color(scene, mesh, triangle, b1, b2, rgba);
    const float covered = coverage(m, rgba[3]);
    float let = covered * transmission_at(scene, m,
                                          interpolated(scene->texcoord_base + mesh->vertex_first,
                                                       corners_of(scene, triangle), b1, b2));
    passage->opacity = covered - let;
    if (scene->panes != NULL)
        let *= kiln_pane_share(scene->panes[material], cosine);
    for (int c = 0; c < 3; c++)
        passage->through[c] = (1.0f - covered) + let * rgba[c];
}

float kiln_surface_opacity(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1,
                           float b2)
{
    const struct kiln_material *m = &scene->materials[scene->triangle_materials[triangle]];
    const uint32_t *corner = corners_of(scene, triangle);
    const struct kiln_vec2 uv = interpolated(scene->texcoord_base + mesh->vertex_first, corner, b1, b2);
    float covered = 1.0f;
    if (m->alpha_mode != KILN_ALPHA_OPAQUE) {
        const uint8_t *codes = scene->colors + 4 * mesh->vertex_first;
        const float vertex =
            ((1.0f - b1 - b2) * (float)codes[4 * (size_t)corner[0] + 3] + b1 * (float)codes[4 * (size_t)corner[1] + 3] +
             b2 * (float)codes[4 * (size_t)corner[2] + 3]) /
            255.0f;
        float alpha = m->base_color[3] * vertex;
        if (m->base_color_texture != KILN_NONE)
            alpha *= texture_channel(scene, m->base_color_texture, uv, 3);
        covered = coverage(m, fminf(fmaxf(alpha, 0.0f), 1.0f));
    }
    return covered - covered * transmission_at(scene, m, uv);
}

void kiln_paint_prepare(struct kiln_paint *paint, const struct kiln_scene *scene, const struct kiln_mesh *mesh,
                        uint64_t triangle)
{
    prepare(scene, mesh, triangle, 1.0f - scene->materials[scene->triangle_materials[triangle]].metallic, paint);
}

void kiln_paint_colors(const struct kiln_paint *paint, const float *b1, const float *b2, int count, float (*rgba)[4])
{
    paint_some(paint, b1, b2, count, rgba);
}

void kiln_surface_color(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1,
                        float b2, float rgba[4])
{
    surface_color(scene, mesh, triangle, b1, b2, 1.0f - scene->materials[scene->triangle_materials[triangle]].metallic,
                  rgba);
}

void kiln_surface_base_color(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1,
                             float b2, float rgba[4])
{
    surface_color(scene, mesh, triangle, b1, b2, 1.0f, rgba);
}

void kiln_surface_emission(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1,
                           float b2, float rgb[3])
{
    const struct kiln_material *m = &scene->materials[scene->triangle_materials[triangle]];
    float sample[4] = {1.0f, 1.0f, 1.0f, 1.0f};
    if (m->emission_texture != KILN_NONE) {
        const struct kiln_vec2 uv =
            interpolated(scene->texcoord_emission + mesh->vertex_first, corners_of(scene, triangle), b1, b2);
        kiln_texture_sample(scene, m->emission_texture, uv.x, uv.y, sample);
    }
    for (int c = 0; c < 3; c++)
        rgb[c] = m->emission[c] * sample[c];
}

/* ---- the mean over a triangle ----
 *
 * A texture coordinate is affine over a triangle, so the mean over the triangle is the mean over its image in texel
 * space. There the filter is a polynomial in each cell: constant for nearest filtering; a x y + b x + c y + d between
 * four texel centres for bilinear filtering. The image is cut along the cell borders, and each piece is integrated
 * exactly by the edge-midpoint rule, which holds for polynomials of degree 2 on a triangle (Strang and Fix, "An
 * Analysis of the Finite Element Method", 1973). */

enum { POLYGON_MAX = 12 };

struct polygon {
    int count;
    double x[POLYGON_MAX], y[POLYGON_MAX];
};

/* Clips to one half-plane: keeps sign * (coordinate - bound) >= 0 (Sutherland and Hodgman 1974). */
static void cut(const struct polygon *in, bool along_x, double bound, double sign, struct polygon *out)
{
    out->count = 0;
    for (int i = 0; i < in->count; i++) {
        const int j = i + 1 == in->count ? 0 : i + 1;
        const double a = sign * ((along_x ? in->x[i] : in->y[i]) - bound),
                     b = sign * ((along_x ? in->x[j] : in->y[j]) - bound);
        if (a >= 0.0) {
            out->x[out->count] = in->x[i];
            out->y[out->count++] = in->y[i];
        }
        if ((a > 0.0 && b < 0.0) || (a < 0.0 && b > 0.0)) {
            const double t = a / (a - b);
            out->x[out->count] = along_x ? bound : in->x[i] + t * (in->x[j] - in->x[i]);
            out->y[out->count++] = along_x ? in->y[i] + t * (in->y[j] - in->y[i]) : bound;
        }
        assert(out->count <= POLYGON_MAX - 2);
    }
}

struct cell {
    colors corner[4];
    double x, y; /* of the cell's first corner */
    bool nearest;
};

static void load_cell(const struct kiln_scene *scene, const struct kiln_texture *t, double x, double y,
                      struct cell *cell)
{
    cell->x = x;
    cell->y = y;
    cell->nearest = t->nearest != 0;
    for (int k = 0; k < (cell->nearest ? 1 : 4); k++) /* a bilinear cell begins at a texel centre, half a texel in */
        cell->corner[k] = texel_of(t, texel_at(scene, t, wrapped((int64_t)floor(x) + (k & 1), t->width, t->wrap_u),
                                               wrapped((int64_t)floor(y) + (k >> 1), t->height, t->wrap_v)));
}

static double cell_value(const struct cell *cell, int channel, double x, double y)
{
    const double fx = x - cell->x, fy = y - cell->y, a = (double)cell->corner[0][channel];
    if (cell->nearest)
        return a;
    const double b = (double)cell->corner[1][channel], c = (double)cell->corner[2][channel],
                 d = (double)cell->corner[3][channel];
    return a + fx * (b - a) + fy * (c - a) + fx * fy * (a - b - c + d);
}

static void add_piece(const struct cell *cell, const struct polygon *p, double sum[3], double *area)
{
    for (int i = 1; i + 1 < p->count; i++) {
        const double twice =
            (p->x[i] - p->x[0]) * (p->y[i + 1] - p->y[0]) - (p->x[i + 1] - p->x[0]) * (p->y[i] - p->y[0]);
        const double weight = 0.5 * fabs(twice);
        *area += weight;
        for (int c = 0; c < 3; c++)
            sum[c] += weight / 3.0 *
                      (cell_value(cell, c, 0.5 * (p->x[0] + p->x[i]), 0.5 * (p->y[0] + p->y[i])) +
                       cell_value(cell, c, 0.5 * (p->x[i] + p->x[i + 1]), 0.5 * (p->y[i] + p->y[i + 1])) +
                       cell_value(cell, c, 0.5 * (p->x[i + 1] + p->x[0]), 0.5 * (p->y[i + 1] + p->y[0])));
    }
}

static void range_of(const double *values, int count, double *low, double *high)
{
    *low = *high = values[0];
    for (int i = 1; i < count; i++) {
        *low = fmin(*low, values[i]);
        *high = fmax(*high, values[i]);
    }
}

/* Mean by exact integration, cell by cell. `triangle` is in texel coordinates and has an area. */
static void mean_by_cells(const struct kiln_scene *scene, const struct kiln_texture *t, const struct polygon *triangle,
                          double mean[3])
{
    const double shift = t->nearest ? 0.0 : 0.5; /* where the borders of the cells are */
    double sum[3] = {0.0, 0.0, 0.0}, area = 0.0, low, high;
    range_of(triangle->y, triangle->count, &low, &high);
    for (double y = floor(low - shift) + shift; y < high; y += 1.0) {
        struct polygon half, row;
        double left, right;
        cut(triangle, false, y, 1.0, &half);
        cut(&half, false, y + 1.0, -1.0, &row);
        if (row.count < 3)
            continue;
        range_of(row.x, row.count, &left, &right);
        for (double x = floor(left - shift) + shift; x < right; x += 1.0) {
            struct polygon piece;
            struct cell cell;
            cut(&row, true, x, 1.0, &half);
            cut(&half, true, x + 1.0, -1.0, &piece);
            if (piece.count < 3)
                continue;
            load_cell(scene, t, x, y, &cell);
            add_piece(&cell, &piece, sum, &area);
        }
    }
    for (int c = 0; c < 3; c++)
        mean[c] = sum[c] / area;
}

/* Mean over the centres of n^2 equal small triangles. For images without area (a line or a point of the texture) and
 * for those with very many cells. */
static void mean_by_lattice(const struct kiln_scene *scene, uint32_t texture, const struct kiln_vec2 uv[3], int n,
                            double mean[3])
{
    double sum[3] = {0.0, 0.0, 0.0};
    for (int i = 0; i < n; i++)
        for (int j = 0; j < 2 * (n - i) - 1; j++) {
            const double upward = j % 2 == 0 ? 1.0 : 2.0;
            const double b1 = (i + upward / 3.0) / n, b2 = (j / 2 + upward / 3.0) / n;
            const double u =
                (double)uv[0].x + b1 * ((double)uv[1].x - (double)uv[0].x) + b2 * ((double)uv[2].x - (double)uv[0].x);
            const double v =
                (double)uv[0].y + b1 * ((double)uv[1].y - (double)uv[0].y) + b2 * ((double)uv[2].y - (double)uv[0].y);
            float sample[4];
            kiln_texture_sample(scene, texture, (float)u, (float)v, sample);
            for (int c = 0; c < 3; c++)
                sum[c] += (double)sample[c];
        }
    for (int c = 0; c < 3; c++)
        mean[c] = sum[c] / ((double)n * n);
}

static void texture_mean(const struct kiln_scene *scene, uint32_t index, const struct kiln_vec2 uv[3], double mean[3])
{
    const struct kiln_texture *t = &scene->textures[index];
    struct polygon image = {.count = 3};
    double low[2], high[2];
    for (int c = 0; c < 3; c++) {
        image.x[c] = (double)uv[c].x * t->width;
        image.y[c] = (double)uv[c].y * t->height;
    }
    range_of(image.x, 3, &low[0], &high[0]);
    range_of(image.y, 3, &low[1], &high[1]);
    const double width = high[0] - low[0], height = high[1] - low[1];
    const double twice_area = fabs((image.x[1] - image.x[0]) * (image.y[2] - image.y[0]) -
                                   (image.x[2] - image.x[0]) * (image.y[1] - image.y[0]));
    const double far = fmax(fmax(fabs(low[0]), fabs(high[0])), fmax(fabs(low[1]), fabs(high[1])));
    if (twice_area <= 1e-9 * fmax(width, height) * fmax(width, height) || twice_area < 1e-12) {
        const double samples = 4.0 * fmax(width, height);
        mean_by_lattice(scene, index, uv,
                        samples < 8.0                ? 8
                        : samples > LINE_SAMPLES_MAX ? LINE_SAMPLES_MAX
                                                     : (int)samples,
                        mean);
    } else if (width + 2.0 > cells_max || height + 2.0 > cells_max || (width + 2.0) * (height + 2.0) > cells_max ||
               far > 1e9) {
        mean_by_lattice(scene, index, uv, LATTICE, mean);
    } else {
        mean_by_cells(scene, t, &image, mean);
    }
}

void kiln_triangle_mean_emission(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle,
                                 float rgb[3])
{
    const struct kiln_material *m = &scene->materials[scene->triangle_materials[triangle]];
    double mean[3] = {1.0, 1.0, 1.0};
    if (m->emission_texture != KILN_NONE) {
        const struct kiln_vec2 *all = scene->texcoord_emission + mesh->vertex_first;
        const uint32_t *corner = corners_of(scene, triangle);
        const struct kiln_vec2 uv[3] = {all[corner[0]], all[corner[1]], all[corner[2]]};
        texture_mean(scene, m->emission_texture, uv, mean);
    }
    for (int c = 0; c < 3; c++)
        rgb[c] = (float)((double)m->emission[c] * mean[c]);
}
