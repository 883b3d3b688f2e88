#include "coordinator/output/view.h"

#include <math.h>
#include <stdio.h>

#include "coordinator/output/exr.h"
#include "coordinator/output/publish.h"
#include "worker/base/memory.h"
#include "worker/scene/texture.h"

/* Rays of a band of pixel rows are traced together; about 2^19 of them, 25 MB. */
enum { BAND_RAYS = 1 << 19, MOST_BACK_FACES = 64 };

struct renderer {
    const struct kiln_view_params *params;
    uint32_t side;
    struct lightmap {
        struct kiln_image *image; /* NULL until needed */
        float *planes[3];
    } *lightmaps; /* one an object */
    struct kiln_vec3 *origins, *directions;
    struct kiln_hit *hits;
    uint32_t *active;              /* rays still under way: their place in the band */
    struct kiln_vec3 *active_origins, *active_directions;
    struct kiln_hit *active_hits;
    float *planes[3];
};

static void make_ray(const struct renderer *r, uint32_t x, uint32_t y, uint32_t sub, struct kiln_vec3 *origin, struct kiln_vec3 *direction)
{
    const struct kiln_view_params *p = r->params;
    const struct kiln_view_camera *c = &p->camera;
    const double sx = ((double)x + ((double)(sub % r->side) + 0.5) / r->side) / p->width * 2.0 - 1.0;
    const double sy = 1.0 - ((double)y + ((double)(sub / r->side) + 0.5) / r->side) / p->height * 2.0;
    const struct kiln_dvec3 aside = dvec3_add(dvec3_scale(c->right, sx * c->extent_x), dvec3_scale(c->up, sy * c->extent_y));
    const struct kiln_dvec3 way = c->orthographic ? c->forward : dvec3_add(c->forward, aside);
    *origin = vec3_of(c->orthographic ? dvec3_add(c->position, aside) : c->position);
    *direction = vec3_of(dvec3_scale(way, 1.0 / dvec3_length(way)));
}

/* Not seen are the backs of single-sided surfaces, and what is caster-only, unless it emits: there is no lightmap of it. */
static bool is_seen(const struct kiln_view_params *p, const struct kiln_hit *hit)
{
    if (hit->triangle == KILN_NONE)
        return true;
    const struct kiln_hit_record *record = &p->geometry->records[hit->triangle];
    if ((p->scene->objects[record->object].flags & KILN_OBJECT_CASTER_ONLY) != 0 && (record->material & KILN_RECORD_EMITS) == 0)
        return false;
    return !hit->back || (record->material & KILN_RECORD_DOUBLE_SIDED) != 0;
}

/* Traces rays 0..count-1; those that meet something that is not seen go on behind it. */
static int trace(struct renderer *r, size_t count, struct kiln_error *error)
{
    const struct kiln_geometry *g = r->params->geometry;
    int status = kiln_backend_intersect(r->params->backend, r->origins, r->directions, count, r->hits, error);
    for (int step = 0; status == KILN_OK && step < MOST_BACK_FACES; step++) {
        size_t active = 0;
        for (size_t i = 0; i < count; i++) {
            if (is_seen(r->params, &r->hits[i]))
                continue;
            const float beyond = r->hits[i].distance * (1.0f + 1e-6f) + 1e-6f * g->extent;
            r->origins[i] = vec3_madd(r->origins[i], r->directions[i], beyond);
            r->active[active] = (uint32_t)i;
            r->active_origins[active] = r->origins[i];
            r->active_directions[active++] = r->directions[i];
        }
        if (active == 0)
            break;
        status = kiln_backend_intersect(r->params->backend, r->active_origins, r->active_directions, active, r->active_hits, error);
        for (size_t i = 0; status == KILN_OK && i < active; i++)
            r->hits[r->active[i]] = r->active_hits[i];
    }
    return status;
}

static int load_lightmap(struct renderer *r, uint32_t object, struct kiln_error *error)
{
    static const char *const wanted[] = {"R", "G", "B"};
    const struct kiln_scene *scene = r->params->scene;
    const struct kiln_object *o = &scene->objects[object];
    struct lightmap *lightmap = &r->lightmaps[object];
    char path[KILN_PATH_SIZE];
    const int length = snprintf(path, sizeof path, "%s/lightmaps/%s.exr", r->params->directory, kiln_scene_string(scene, o->name));
    if (length < 0 || length >= KILN_PATH_SIZE)
        return kiln_fail(error, KILN_NO_INPUT, "the path of the lightmap of object %u is too long", object);
    const int status = kiln_exr_read(path, wanted, 3, &lightmap->image, error);
    if (status != KILN_OK)
        return status;
    const struct kiln_image *map = lightmap->image;
    if (map->width != o->lightmap_width || map->height != o->lightmap_height || !kiln_image_rgb(map, "", lightmap->planes))
        return kiln_fail(error, KILN_BAD_INPUT, "'%s' is not the lightmap of this scene's object: it has %u x %u texels, the scene says %u x %u",
                         path, map->width, map->height, o->lightmap_width, o->lightmap_height);
    return KILN_OK;
}

static int load_lightmaps(struct renderer *r, size_t count, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; status == KILN_OK && i < count; i++) {
        if (r->hits[i].triangle == KILN_NONE)
            continue;
        const uint32_t object = r->params->geometry->records[r->hits[i].triangle].object;
        if (r->lightmaps[object].image == NULL && (r->params->scene->objects[object].flags & KILN_OBJECT_CASTER_ONLY) == 0)
            status = load_lightmap(r, object, error);
    }
    return status;
}

/* Irradiance at texel coordinate (x, y), as a sampler that clamps at the edge. */
static void look_up(const struct lightmap *lightmap, float x, float y, float rgb[3])
{
    const struct kiln_image *map = lightmap->image;
    const float fx = fminf(fmaxf(x - 0.5f, 0.0f), (float)(map->width - 1)), fy = fminf(fmaxf(y - 0.5f, 0.0f), (float)(map->height - 1));
    const uint32_t x0 = (uint32_t)fx, y0 = (uint32_t)fy;
    const uint32_t x1 = x0 + 1 < map->width ? x0 + 1 : x0, y1 = y0 + 1 < map->height ? y0 + 1 : y0;
    const float wx = fx - (float)x0, wy = fy - (float)y0;
    for (int c = 0; c < 3; c++) {
        const float *row0 = lightmap->planes[c] + (size_t)y0 * map->width, *row1 = lightmap->planes[c] + (size_t)y1 * map->width;
        rgb[c] = (1.0f - wy) * ((1.0f - wx) * row0[x0] + wx * row0[x1]) + wy * ((1.0f - wx) * row1[x0] + wx * row1[x1]);
    }
}

static void shade(const struct renderer *r, const struct kiln_hit *hit, struct kiln_vec3 direction, float rgb[3])
{
    const struct kiln_view_params *p = r->params;
    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    if (hit->triangle == KILN_NONE || !is_seen(p, hit)) {
        if (p->lights != NULL)
            kiln_environment_radiance(p->lights, dvec3_of(direction), rgb);
        return;
    }
    const struct kiln_hit_record *record = &p->geometry->records[hit->triangle];
    const struct kiln_mesh *mesh = &p->scene->meshes[p->scene->objects[record->object].mesh];
    const uint64_t stored = p->geometry->stored_triangle[hit->triangle];
    const float x = record->texel[0] + hit->u * record->texel[2] + hit->v * record->texel[4];
    const float y = record->texel[1] + hit->u * record->texel[3] + hit->v * record->texel[5];
    float albedo[4], irradiance[3] = {0.0f, 0.0f, 0.0f}, emission[3];
    kiln_surface_color(p->scene, mesh, stored, hit->u, hit->v, albedo);
    kiln_surface_emission(p->scene, mesh, stored, hit->u, hit->v, emission);
    if (r->lightmaps[record->object].image != NULL)
        look_up(&r->lightmaps[record->object], x, y, irradiance);
    for (int c = 0; c < 3; c++)
        rgb[c] = albedo[c] * irradiance[c] * (float)(1.0 / KILN_PI) + emission[c];
}

static int render_band(struct renderer *r, uint32_t first, uint32_t rows, struct kiln_error *error)
{
    const uint32_t width = r->params->width, rays = r->side * r->side;
    const size_t pixels = (size_t)rows * width, count = pixels * rays;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++)
        make_ray(r, (uint32_t)(i / rays % width), first + (uint32_t)(i / rays / width), (uint32_t)(i % rays), &r->origins[i], &r->directions[i]);
    int status = trace(r, count, error);
    if (status == KILN_OK)
        status = load_lightmaps(r, count, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < pixels; i++) {
        float sum[3] = {0};
        for (size_t k = i * rays; k < (i + 1) * rays; k++) {
            float rgb[3];
            shade(r, &r->hits[k], r->directions[k], rgb);
            for (int c = 0; c < 3; c++)
                sum[c] += rgb[c];
        }
        for (int c = 0; c < 3; c++)
            r->planes[c][(size_t)first * width + i] = sum[c] / (float)rays;
    }
    return KILN_OK;
}

static int allocate_renderer(struct renderer *r, size_t rays, struct kiln_error *error)
{
    int status = kiln_allocate(&r->lightmaps, r->params->scene->object_count, sizeof *r->lightmaps, "lightmaps in view", error);
    struct kiln_vec3 **vectors[] = {&r->origins, &r->directions, &r->active_origins, &r->active_directions};
    for (size_t i = 0; status == KILN_OK && i < sizeof vectors / sizeof *vectors; i++)
        status = kiln_allocate(vectors[i], rays, sizeof(struct kiln_vec3), "rays of a view", error);
    if (status == KILN_OK)
        status = kiln_allocate(&r->hits, rays, sizeof *r->hits, "hits of a view", error);
    if (status == KILN_OK)
        status = kiln_allocate(&r->active_hits, rays, sizeof *r->hits, "hits of a view", error);
    if (status == KILN_OK)
        status = kiln_allocate(&r->active, rays, sizeof *r->active, "rays of a view", error);
    return status;
}

static void destroy_renderer(struct renderer *r)
{
    for (size_t i = 0; r->lightmaps != NULL && i < r->params->scene->object_count; i++)
        kiln_image_destroy(&r->lightmaps[i].image);
    kiln_free(&r->lightmaps);
    kiln_free(&r->origins);
    kiln_free(&r->directions);
    kiln_free(&r->active_origins);
    kiln_free(&r->active_directions);
    kiln_free(&r->hits);
    kiln_free(&r->active_hits);
    kiln_free(&r->active);
}

int kiln_view_render(const struct kiln_view_params *params, struct kiln_image **image, struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    struct renderer r = {.params = params, .side = params->side == 0 ? 3 : params->side};
    const size_t row = (size_t)params->width * r.side * r.side;
    const uint32_t rows = row >= BAND_RAYS ? 1 : (uint32_t)(BAND_RAYS / row);
    int status = kiln_image_create(image, params->width, params->height, names, 3, error);
    if (status != KILN_OK)
        return status;
    (void)kiln_image_rgb(*image, "", r.planes);
    status = allocate_renderer(&r, row * rows, error);
    for (uint32_t y = 0; status == KILN_OK && y < params->height; y += rows)
        status = render_band(&r, y, params->height - y < rows ? params->height - y : rows, error);
    destroy_renderer(&r);
    if (status != KILN_OK)
        kiln_image_destroy(image);
    return status;
}

static int draw_preview(const struct kiln_view_params *seen, double stops, struct kiln_error *error)
{
    const struct kiln_view_wish wish = {0};
    struct kiln_view_params params = *seen;
    struct kiln_image *image = NULL;
    char path[KILN_PATH_SIZE];
    int status = kiln_path_join(path, params.directory, "preview.png", error);
    if (status == KILN_OK)
        status = kiln_view_aim(params.scene, &wish, &params.camera, &params.width, &params.height, error);
    if (status == KILN_OK)
        status = kiln_view_render(&params, &image, error);
    if (status == KILN_OK)
        status = kiln_png_write(path, image, NULL, stops, error);
    kiln_image_destroy(&image);
    return status;
}

/* The bake's rays do not meet receiver-only objects: where there are such, the picture is made with a tree of its own. */
static int draw_with_receivers(struct kiln_view_params *params, double stops, struct kiln_error *error)
{
    struct kiln_geometry *geometry = NULL;
    struct kiln_backend *backend = NULL;
    int status = kiln_geometry_create(&geometry, params->scene, error);
    if (status == KILN_OK) {
        kiln_geometry_meet_all(geometry);
        const struct kiln_backend_params own = {.scene = params->scene, .geometry = geometry, .lights = params->lights, .threads = params->backend->params.threads};
        status = kiln_backend_create(&backend, "embree", &own, error);
    }
    if (status == KILN_OK) {
        params->geometry = geometry;
        params->backend = backend;
        status = draw_preview(params, stops, error);
    }
    kiln_backend_destroy(&backend);
    kiln_geometry_destroy(&geometry);
    return status;
}

int kiln_view_preview(const char *directory, const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                      const struct kiln_lights *lights, struct kiln_backend *backend, double stops, struct kiln_error *error)
{
    struct kiln_view_params params = {.directory = directory, .scene = scene, .geometry = geometry, .lights = lights, .backend = backend,
                                      .side = 2};
    const bool all_met = kiln_geometry_met_count(geometry) == geometry->triangle_count;
    return all_met ? draw_preview(&params, stops, error) : draw_with_receivers(&params, stops, error);
}
