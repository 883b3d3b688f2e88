#include "coordinator/view/view.h"

#include <math.h>
#include <stdio.h>

#include "coordinator/files/publish.h"
#include "coordinator/view/view_light.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

/* Rays of a band of pixel rows are traced together: about 2^19 rays, 63 MB. */
enum { BAND_RAYS = 1 << 19 };

struct renderer {
    const struct kiln_view_params *params;
    uint32_t side;
    struct kiln_view_maps *maps;
    struct kiln_view_rays *rays;
    float *planes[3];
    struct kiln_view_approximate sums; /* over rays */
};

static void make_ray(const struct renderer *r, uint32_t x, uint32_t y, uint32_t sub, struct kiln_vec3 *origin,
                     struct kiln_vec3 *direction)
{
    const struct kiln_view_params *p = r->params;
    const struct kiln_view_camera *c = &p->camera;
    const double sx = ((double)x + ((double)(sub % r->side) + 0.5) / r->side) / p->width * 2.0 - 1.0;
    const double sy = 1.0 - ((double)y + ((double)(sub / r->side) + 0.5) / r->side) / p->height * 2.0;
    const struct kiln_dvec3 aside =
        dvec3_add(dvec3_scale(c->right, sx * c->extent_x), dvec3_scale(c->up, sy * c->extent_y));
    const struct kiln_dvec3 way = c->orthographic ? c->forward : dvec3_add(c->forward, aside);
    *origin = vec3_of(c->orthographic ? dvec3_add(c->position, aside) : c->position);
    *direction = vec3_of(dvec3_scale(way, 1.0 / dvec3_length(way)));
}

/* Computes a pixel as the mean over its rays. */
static void shade_pixel(const struct renderer *r, size_t first, uint32_t rays, float rgb[3],
                        struct kiln_view_approximate *row)
{
    for (int c = 0; c < 3; c++)
        rgb[c] = 0.0f;
    for (size_t k = first; k < first + rays; k++) {
        struct kiln_view_seen seen;
        kiln_view_radiance(r->maps, &r->rays->hits[k], r->rays->directions[k], &seen);
        for (int c = 0; c < 3; c++)
            rgb[c] += seen.rgb[c] / (float)rays;
        row->metal += (double)seen.metal;
        row->front_light += (double)seen.front_light;
        row->flat += (double)seen.flat;
        row->mapped += (double)seen.mapped;
    }
}

/* Renders a band of rows. The approximate fractions are summed row by row, so that they do not depend on threads. */
static int render_band(struct renderer *r, uint32_t first, uint32_t rows, struct kiln_error *error)
{
    const uint32_t width = r->params->width, rays = r->side * r->side;
    const size_t count = (size_t)rows * width * rays;
    struct kiln_view_approximate *row_sums = NULL;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++)
        make_ray(r, (uint32_t)(i / rays % width), first + (uint32_t)(i / rays / width), (uint32_t)(i % rays),
                 &r->rays->origins[i], &r->rays->directions[i]);
    int status = kiln_view_trace(&r->params->source, r->rays, count, error);
    if (status == KILN_OK)
        status = kiln_view_maps_load(r->maps, r->rays->hits, count, error);
    if (status == KILN_OK)
        status = kiln_allocate(&row_sums, rows, sizeof *row_sums, "rows of a view", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(static)
    for (uint32_t y = 0; y < rows; y++)
        for (uint32_t x = 0; x < width; x++) {
            float rgb[3];
            const size_t pixel = (size_t)y * width + x;
            shade_pixel(r, pixel * rays, rays, rgb, &row_sums[y]);
            for (int c = 0; c < 3; c++)
                r->planes[c][(size_t)first * width + pixel] = rgb[c];
        }
    for (uint32_t y = 0; y < rows; y++) {
        r->sums.metal += row_sums[y].metal;
        r->sums.front_light += row_sums[y].front_light;
        r->sums.flat += row_sums[y].flat;
        r->sums.mapped += row_sums[y].mapped;
    }
    kiln_free(&row_sums);
    return KILN_OK;
}

int kiln_view_render(const struct kiln_view_params *params, struct kiln_image **image,
                     struct kiln_view_approximate *approximate, struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    struct renderer r = {.params = params, .side = params->side == 0 ? 3 : params->side};
    const size_t row = (size_t)params->width * r.side * r.side;
    const uint32_t rows = row >= BAND_RAYS ? 1 : (uint32_t)(BAND_RAYS / row);
    int status = kiln_image_create(image, params->width, params->height, names, 3, error);
    if (status != KILN_OK)
        return status;
    (void)kiln_image_rgb(*image, "", r.planes);
    status = kiln_view_maps_create(&r.maps, &params->source, 0, error);
    if (status == KILN_OK)
        status = kiln_view_rays_create(&r.rays, row * rows, error);
    for (uint32_t y = 0; status == KILN_OK && y < params->height; y += rows)
        status = kiln_stop_asked(params->source.stop)
                     ? kiln_give_up(error)
                     : render_band(&r, y, params->height - y < rows ? params->height - y : rows, error);
    const double all = (double)row * params->height;
    *approximate = (struct kiln_view_approximate){r.sums.metal / all, r.sums.front_light / all, r.sums.flat / all,
                                                  r.sums.mapped / all};
    kiln_view_rays_destroy(&r.rays);
    kiln_view_maps_destroy(&r.maps);
    if (status != KILN_OK)
        kiln_image_destroy(image);
    return status;
}

/* ---- pictures ---- */

static int make_picture(const struct kiln_view_source *source, const struct kiln_view_wish *wish, uint32_t side,
                        struct kiln_picture *picture, struct kiln_error *error)
{
    struct kiln_view_params params = {.source = *source, .side = side};
    *picture = (struct kiln_picture){0};
    struct kiln_view_source lit = *source; /* whatever is shown, it is seen from where light would be */
    lit.field = NULL;
    int status = kiln_view_aim(&lit, wish, &params.camera, &params.width, &params.height, &picture->viewpoint, error);
    if (status == KILN_OK)
        status = kiln_view_render(&params, &picture->image, &picture->approximate, error);
    if (source->field != NULL)
        picture->meaning = source->field->meaning;
    if (status == KILN_OK && picture->meaning == KILN_FIELD_AMOUNT)
        picture->exposure = log2(kiln_auto_exposure(picture->image, NULL).scale);
    return status;
}

int kiln_picture_make(const struct kiln_view_source *source, const struct kiln_view_wish *wish, uint32_t side,
                      struct kiln_picture *picture, struct kiln_error *error)
{
    if (kiln_geometry_hittable_count(source->geometry) == source->geometry->triangle_count)
        return make_picture(source, wish, side, picture, error);
    struct kiln_view_source own = *source;
    struct kiln_geometry *geometry = NULL;
    own.backend = NULL;
    int status = kiln_geometry_create(&geometry, source->scene, error);
    if (status == KILN_OK) {
        kiln_geometry_make_all_hittable(geometry);
        own.geometry = geometry;
        const struct kiln_backend_params params = {.scene = source->scene,
                                                   .geometry = geometry,
                                                   .lights = source->lights,
                                                   .threads = source->backend->params.threads,
                                                   .stop = source->stop};
        status = kiln_backend_create(&own.backend, "embree", &params, error);
    }
    if (status == KILN_OK)
        status = make_picture(&own, wish, side, picture, error);
    kiln_backend_destroy(&own.backend);
    kiln_geometry_destroy(&geometry);
    return status;
}

void kiln_viewpoint_text(const struct kiln_viewpoint *v, char text[KILN_VIEWPOINT_TEXT])
{
    char place[200];
    (void)snprintf(place, sizeof place, "at %.4g,%.4g,%.4g towards %.4g,%.4g,%.4g", v->from[0], v->from[1], v->from[2],
                   v->to[0], v->to[1], v->to[2]);
    if (v->kind == KILN_VIEW_CAMERA)
        (void)snprintf(text, KILN_VIEWPOINT_TEXT, "seen by the scene's camera '%s'",
                       kiln_text_plain(place, sizeof place, v->camera));
    else if (v->kind == KILN_VIEW_GIVEN)
        (void)snprintf(text, KILN_VIEWPOINT_TEXT, "seen as asked, %s", place);
    else
        (void)snprintf(
            text, KILN_VIEWPOINT_TEXT,
            "seen from %s, %s: the scene has no camera (kiln view --from X,Y,Z --to X,Y,Z looks from elsewhere)",
            v->kind == KILN_VIEW_INSIDE ? "inside" : "outside", place);
}

/* Which colour is which value. */
static void scale_text(const struct kiln_picture *picture, double stops, char text[160])
{
    char added[80] = "";
    if (stops != 0.0)
        (void)snprintf(added, sizeof added, " and %+.4g asked for", stops);
    if (picture->meaning == KILN_FIELD_FRACTION)
        (void)snprintf(text, 160, "white is 1, black is 0");
    else if (picture->meaning == KILN_FIELD_DIRECTION)
        (void)snprintf(text, 160, "red, green and blue are x, y and z, from -1 to 1");
    else
        (void)snprintf(text, 160, "exposure %+.2f stops, automatic%s (--exposure STOPS adds to it)", picture->exposure,
                       added);
}

void kiln_picture_text(const struct kiln_picture *picture, double stops, char text[KILN_PICTURE_TEXT])
{
    char viewpoint[KILN_VIEWPOINT_TEXT], scale[160], metals[120] = "", backs[120] = "";
    kiln_viewpoint_text(&picture->viewpoint, viewpoint);
    scale_text(picture, stops, scale);
    if (picture->approximate.front_light > 0.0005)
        (void)snprintf(backs, sizeof backs,
                       "\nbacks of double-sided surfaces, %.1f %% of it, show their fronts' light: approximate",
                       100.0 * picture->approximate.front_light);
    if (picture->approximate.metal > 0.0005)
        (void)snprintf(metals, sizeof metals,
                       "\nmetals, %.1f %% of it, are shown by their base colour under the irradiance: approximate",
                       100.0 * picture->approximate.metal);
    (void)snprintf(text, KILN_PICTURE_TEXT, "%s\n%s%s%s", viewpoint, scale, metals, backs);
}

json_t *kiln_picture_json(const struct kiln_picture *picture, double stops)
{
    /* in the order of enum kiln_view_kind */
    static const char *const kinds[] = {"camera", "given", "inside", "outside"};
    const struct kiln_viewpoint *v = &picture->viewpoint;
    return json_pack("{s:{s:s, s:s*, s:[f,f,f], s:[f,f,f]}, s:{s:f, s:f}, s:f, s:f}", "viewpoint", "chosen",
                     kinds[v->kind], "camera", v->camera, "from", v->from[0], v->from[1], v->from[2], "to", v->to[0],
                     v->to[1], v->to[2], "exposure", "automatic", picture->exposure, "added", stops, "metal_share",
                     picture->approximate.metal, "front_light_share", picture->approximate.front_light);
}

int kiln_picture_write(const char *directory, const char *name, const struct kiln_picture *picture, double stops,
                       struct kiln_error *error)
{
    char text[KILN_PICTURE_TEXT];
    kiln_picture_text(picture, stops, text);
    if (picture->meaning == KILN_FIELD_FRACTION)
        return kiln_png_write_values(directory, name, picture->image, 1.0, 0.0, text, error);
    if (picture->meaning == KILN_FIELD_DIRECTION)
        return kiln_png_write_values(directory, name, picture->image, 0.5, 0.5, text, error);
    return kiln_png_write(directory, name, picture->image, NULL, stops, text, error);
}
