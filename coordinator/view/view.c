#include "coordinator/view/view.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/files/publish.h"
#include "coordinator/view/false_color.h"
#include "coordinator/view/light_level.h"
#include "coordinator/view/view_filter.h"
#include "coordinator/view/view_surfaces.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"
#include "worker/scene/leaves.h"

/* ---- pictures ---- */

/* Whether the colours of a picture have a range. */
static bool has_range(const struct kiln_picture *picture)
{
    return picture->meaning == KILN_FIELD_SCALE || picture->meaning == KILN_FIELD_PLACE;
}

static int make_picture(const struct kiln_view_source *source, const struct kiln_view_wish *wish, uint32_t side,
                        const struct kiln_look *look, struct kiln_picture *picture, struct kiln_error *error)
{
    struct kiln_view_params params = {.source = *source, .side = side};
    *picture = (struct kiln_picture){.exposure = kiln_plain_exposure, .metering = KILN_METERED_NOTHING};
    struct kiln_view_source lit = *source; /* a view of any field is aimed as if light were shown */
    lit.field = NULL;
    int status = kiln_view_aim(&lit, wish, &params.camera, &params.width, &params.height, &picture->viewpoint, error);
    const struct kiln_view_renderer *renderer = source->renderer;
    if (wish->filter != NULL)
        kiln_view_filter_prepare(wish->filter, &params);
    KILN_TRY(status);
    if (renderer != NULL)
        KILN_TRY(renderer->render(renderer->context, &params, &picture->image, error));
    else
        KILN_TRY(kiln_view_render(&params, &picture->image, &picture->approximate, error));
    if (wish->filter != NULL)
        KILN_TRY(kiln_view_filter_run(wish->filter, &params, &picture->image, error));
    if (wish->surfaces)
        KILN_TRY(kiln_view_add_surfaces(&params, &picture->image, error));
end:
    return status == KILN_OK ? kiln_picture_fit(source, look, picture, error) : status;
}

static double level_of(const struct kiln_view_source *source)
{
    return source->lights != NULL ? kiln_light_level(source->lights, source->geometry) : 0.0;
}

int kiln_picture_fit(const struct kiln_view_source *source, const struct kiln_look *look, struct kiln_picture *picture,
                     struct kiln_error *error)
{
    if (source->field != NULL)
        picture->meaning = source->field->meaning;
    if (picture->meaning == KILN_FIELD_AMOUNT && !look->no_metering) {
        picture->exposure = look->kept != NULL ? *look->kept : kiln_auto_exposure(picture->image, level_of(source));
        picture->metering = look->kept != NULL ? KILN_METERED_BEFORE : KILN_METERED_PICTURE;
    }
    return has_range(picture) ? kiln_false_color_fit(picture, error) : KILN_OK;
}

int kiln_picture_make(const struct kiln_view_source *source, const struct kiln_view_wish *wish, uint32_t side,
                      const struct kiln_look *look, struct kiln_picture *picture, struct kiln_error *error)
{
    if (source->renderer != NULL || kiln_geometry_hittable_count(source->geometry) == source->geometry->triangle_count)
        return make_picture(source, wish, side, look, picture, error);
    struct kiln_view_source own = *source;
    struct kiln_geometry *geometry = NULL;
    own.backend = NULL;
    int status;
    KILN_TRY(kiln_geometry_create(&geometry, source->scene, error));
    if (source->geometry->leaves != NULL)
        KILN_TRY(kiln_leaves_lay(geometry, source->geometry->leaf_size, error));
    kiln_geometry_make_all_hittable(geometry);
    own.geometry = geometry;
    const struct kiln_backend_params params = {.scene = source->scene,
                                               .geometry = geometry,
                                               .lights = source->lights,
                                               .threads = source->backend->params.threads,
                                               .stop = source->stop};
    KILN_TRY(kiln_backend_create(&own.backend, "embree", &params, error));
    KILN_TRY(make_picture(&own, wish, side, look, picture, error));
end:
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
    else if (v->kind == KILN_VIEW_ATLAS)
        (void)snprintf(text, KILN_VIEWPOINT_TEXT, "the lightmap of '%s'",
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
static void scale_text(const struct kiln_picture *picture, const struct kiln_look *look, char text[200])
{
    static const char *const automatic[] = {"automatic", "automatic for all frames together",
                                            "that of the bake before"};
    const char *curve = kiln_tone_name(look->curve), *unit = picture->unit;
    char added[80] = "";
    if (look->stops != 0.0)
        (void)snprintf(added, sizeof added, " and %+.4g asked for", look->stops);
    if (picture->key != NULL)
        (void)snprintf(text, 200, "%s", picture->key->note);
    else if (picture->meaning == KILN_FIELD_FRACTION)
        (void)snprintf(text, 200, "white is 1, black is 0");
    else if (picture->meaning == KILN_FIELD_DIRECTION)
        (void)snprintf(text, 200, "red, green and blue are x, y and z, from -1 to 1");
    else if (picture->meaning == KILN_FIELD_COLOR)
        (void)snprintf(text, 200, "colours as they are: white is 1 of red, green and blue");
    else if (picture->meaning == KILN_FIELD_PLACE)
        (void)snprintf(text, 200,
                       "red, green and blue are x from %.4g to %.4g, y from %.4g to %.4g, z from %.4g to %.4g%s%s",
                       picture->low[0], picture->high[0], picture->low[1], picture->high[1], picture->low[2],
                       picture->high[2], unit != NULL ? " " : "", unit != NULL ? unit : "");
    else if (picture->meaning == KILN_FIELD_SCALE && !(picture->low[0] < picture->high[0]))
        (void)snprintf(text, 200, "dark violet: %.4g%s%s; grey: no value", picture->low[0], unit != NULL ? " " : "",
                       unit != NULL ? unit : "");
    else if (picture->meaning == KILN_FIELD_SCALE)
        (void)snprintf(text, 200, "from dark violet, %.4g or less, to yellow, %.4g or more%s%s; grey: no value",
                       picture->low[0], picture->high[0], unit != NULL ? " " : "", unit != NULL ? unit : "");
    else if (picture->metering == KILN_METERED_NOTHING)
        (void)snprintf(text, 200, "exposure %+.4g stops, not automatic; tone map %s", look->stops, curve);
    else
        (void)snprintf(text, 200, "exposure %+.2f stops, %s%s (--exposure STOPS adds to it); tone map %s",
                       log2(picture->exposure.scale), automatic[picture->metering], added, curve);
}

void kiln_picture_notes(const struct kiln_picture *picture, const struct kiln_look *look, char text[KILN_PICTURE_TEXT])
{
    char scale[200], metals[120] = "", backs[120] = "";
    scale_text(picture, look, scale);
    if (picture->approximate.front_light > 0.0005)
        (void)snprintf(backs, sizeof backs,
                       "\nbacks of double-sided surfaces, %.1f %% of it, show their fronts' light: approximate",
                       100.0 * picture->approximate.front_light);
    if (picture->approximate.metal > 0.0005)
        (void)snprintf(metals, sizeof metals,
                       "\nmetals, %.1f %% of it, are shown by their base colour under the irradiance: approximate",
                       100.0 * picture->approximate.metal);
    (void)snprintf(text, KILN_PICTURE_TEXT, "%s%s%s%s%s", scale, metals, backs, picture->note != NULL ? "\n" : "",
                   picture->note != NULL ? picture->note : "");
}

json_t *kiln_picture_json(const struct kiln_picture *picture, const struct kiln_look *look)
{
    /* in the order of enum kiln_view_kind */
    static const char *const kinds[] = {"camera", "given", "inside", "outside", "atlas"};
    const struct kiln_viewpoint *v = &picture->viewpoint;
    json_t *json = json_pack("{s:{s:s, s:s*, s:[f,f,f], s:[f,f,f]}, s:{s:f, s:f, s:f}, s:s*, s:f, s:f}", "viewpoint",
                             "chosen", kinds[v->kind], "camera", v->camera, "from", v->from[0], v->from[1], v->from[2],
                             "to", v->to[0], v->to[1], v->to[2], "exposure", "automatic", log2(picture->exposure.scale),
                             "added", look->stops, "white", fmin(picture->exposure.white, 1e30), "tone_map",
                             picture->meaning == KILN_FIELD_AMOUNT ? kiln_tone_name(look->curve) : NULL, "metal_share",
                             picture->approximate.metal, "front_light_share", picture->approximate.front_light);
    if (has_range(picture))
        (void)json_object_set_new(json, "scale",
                                  json_pack("{s:[f,f,f], s:[f,f,f], s:s*}", "low", picture->low[0], picture->low[1],
                                            picture->low[2], "high", picture->high[0], picture->high[1],
                                            picture->high[2], "unit", picture->unit));
    return json;
}

static void read_place(const json_t *json, const char *key, double place[3])
{
    for (size_t c = 0; c < 3; c++)
        place[c] = json_number_value(json_array_get(json_object_get(json, key), c));
}

bool kiln_picture_keep(const json_t *preview, struct kiln_kept_picture *kept)
{
    const json_t *exposure = json_object_get(preview, "exposure"), *viewpoint = json_object_get(preview, "viewpoint");
    const char *chosen = json_string_value(json_object_get(viewpoint, "chosen")),
               *curve = json_string_value(json_object_get(preview, "tone_map"));
    const double white = json_number_value(json_object_get(exposure, "white"));
    *kept = (struct kiln_kept_picture){.look.stops = json_number_value(json_object_get(exposure, "added"))};
    if (!json_is_number(json_object_get(exposure, "automatic")) || curve == NULL || chosen == NULL)
        return false;
    const double stops = json_number_value(json_object_get(exposure, "automatic"));
    kept->exposure = (struct kiln_exposure){exp2(fmin(fmax(stops, -200.0), 200.0)), white > 0.0 ? white : 4.0};
    for (int c = KILN_TONE_FILMIC; c <= KILN_TONE_NONE; c++)
        if (strcmp(curve, kiln_tone_name((enum kiln_tone_curve)c)) == 0)
            kept->look.curve = (enum kiln_tone_curve)c;
    kept->look.kept = &kept->exposure;
    kept->inside = strcmp(chosen, "inside") == 0;
    kept->found = kept->inside || strcmp(chosen, "outside") == 0;
    read_place(viewpoint, "from", kept->from);
    read_place(viewpoint, "to", kept->to);
    return true;
}

void kiln_picture_keep_place(const struct kiln_kept_picture *kept, struct kiln_view_wish *wish)
{
    if (!kept->found)
        return;
    wish->from = kept->from;
    wish->to = kept->to;
    wish->field_of_view = kept->inside ? KILN_VIEW_INSIDE_DEGREES : KILN_VIEW_OUTSIDE_DEGREES;
}

int kiln_picture_write(const char *directory, const char *name, const struct kiln_picture *picture,
                       const struct kiln_look *look, struct kiln_error *error)
{
    char viewpoint[KILN_VIEWPOINT_TEXT], notes[KILN_PICTURE_TEXT], text[KILN_VIEWPOINT_TEXT + KILN_PICTURE_TEXT];
    kiln_viewpoint_text(&picture->viewpoint, viewpoint);
    kiln_picture_notes(picture, look, notes);
    (void)snprintf(text, sizeof text, "%s\n%s", viewpoint, notes);
    if (picture->meaning == KILN_FIELD_FRACTION)
        return kiln_png_write_values(directory, name, picture->image, 1.0, 0.0, text, error);
    if (picture->meaning == KILN_FIELD_DIRECTION)
        return kiln_png_write_values(directory, name, picture->image, 0.5, 0.5, text, error);
    if (has_range(picture) || picture->key != NULL)
        return kiln_false_color_write(directory, name, picture, text, error);
    if (picture->meaning == KILN_FIELD_COLOR) {
        const struct kiln_tone plain = {.curve = KILN_TONE_NONE, .exposure = 1.0, .white = INFINITY};
        return kiln_png_write(directory, name, picture->image, &plain, text, error);
    }
    const struct kiln_tone tone = {look->curve, picture->exposure.scale * exp2(look->stops), picture->exposure.white};
    return kiln_png_write(directory, name, picture->image, &tone, text, error);
}

/* ---- exposure of several views ---- */

enum { METER_WIDTH = 96, METER_HEIGHT = 72, MOST_METERED = 48 };

/* Renders a small view into a picture of the size of *all, and copies it below the `index` pictures that are there. */
static int meter_one(const struct kiln_view_source *source, const struct kiln_view_wish *wish, size_t index,
                     struct kiln_image *all, struct kiln_error *error)
{
    const struct kiln_look plain = {.no_metering = true};
    struct kiln_view_wish small = *wish;
    struct kiln_picture picture = {0};
    float *from[3], *to[3];
    small.width = METER_WIDTH;
    small.height = METER_HEIGHT;
    small.surfaces = false;
    small.filter = NULL;
    int status = kiln_picture_make(source, &small, 1, &plain, &picture, error);
    if (status == KILN_OK && kiln_image_rgb(picture.image, "", from) && kiln_image_rgb(all, "", to)) {
        const size_t pixels = (size_t)small.width * small.height;
        for (int c = 0; c < 3; c++)
            memcpy(to[c] + index * pixels, from[c], pixels * sizeof *from[c]);
    }
    kiln_image_destroy(&picture.image);
    return status;
}

int kiln_view_meter(const struct kiln_view_source *source, const struct kiln_view_wish *wishes, size_t count,
                    struct kiln_exposure *exposure, struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    const size_t used = count < MOST_METERED ? count : MOST_METERED;
    struct kiln_image *all = NULL;
    int status;
    KILN_TRY(kiln_image_create(&all, METER_WIDTH, (uint32_t)(METER_HEIGHT * used), names, 3, error));
    for (size_t i = 0; i < used; i++)
        KILN_TRY(meter_one(source, &wishes[used < 2 ? 0 : i * (count - 1) / (used - 1)], i, all, error));
    *exposure = kiln_auto_exposure(all, level_of(source));
end:
    kiln_image_destroy(&all);
    return status;
}
