#include "coordinator/view/view_light.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/output/exr.h"
#include "coordinator/files/publish.h"
#include "coordinator/view/leaf_light.h"
#include "coordinator/view/normal_map.h"
#include "coordinator/view/point_map.h"
#include "coordinator/view/view_gloss.h"
#include "coordinator/view/voxel_view.h"
#include "worker/sampling/keys.h"
#include "worker/base/memory.h"
#include "worker/sampling/sequence.h"
#include "worker/scene/footprint.h"
#include "worker/scene/texture.h"
#include "worker/store/store.h"

/* ---- lightmaps ---- */

/* Numbers of lightmap channels: light; its direction for --directional sh1, and for dominant. */
enum { LIGHT = 3, SH = 3 * KILN_NORMAL_HARMONICS, DOMINANT = 4, CHANNELS = LIGHT + SH + DOMINANT };

/* Their names, those of light first. */
static void name_channels(const char *names[CHANNELS])
{
    static const struct {
        const char *field;
        size_t count;
    } fields[] = {{"total", LIGHT}, {"sh", SH}, {"dominant", DOMINANT}};
    for (size_t f = 0; f < sizeof fields / sizeof *fields; f++) {
        memcpy(names, kiln_field_shown(fields[f].field)->channels, fields[f].count * sizeof *names);
        names += fields[f].count;
    }
}

struct map {
    struct kiln_image *image;                 /* NULL until needed */
    const float *planes[LIGHT];               /* light, or the field shown; missing components repeat the last */
    const float *sh[SH], *dominant[DOMINANT]; /* sh[0], dominant[0]: NULL if missing or not needed */
    float scale_x, scale_y;                   /* from texels of the scene's lightmap to texels here */
    bool looked_for;                          /* of backs */
    bool sparse;                              /* made from points: texels without a point are NaN */
};

struct kiln_view_maps {
    struct kiln_view_source own;           /* a copy */
    const struct kiln_view_source *source; /* = &own */
    uint32_t coarse;
    struct map *maps;                /* one for each object, then one for the back of each object */
    struct kiln_leaf_light *leaves;  /* leaves, for octrees, instead of maps; NULL: not needed, or not loaded */
    struct kiln_point_dataset *rows; /* rows of a field that lightmaps lack; NULL: as above */
};

int kiln_view_maps_create(struct kiln_view_maps **maps, const struct kiln_view_source *source, uint32_t coarse,
                          struct kiln_error *error)
{
    int status = kiln_allocate(maps, 1, sizeof **maps, "lightmaps in view", error);
    if (status != KILN_OK)
        return status;
    (*maps)->own = *source;
    (*maps)->source = &(*maps)->own;
    (*maps)->coarse = coarse;
    status = kiln_allocate(&(*maps)->maps, 2 * source->scene->object_count, sizeof *(*maps)->maps, "lightmaps in view",
                           error);
    if (status != KILN_OK)
        kiln_view_maps_destroy(maps);
    return status;
}

void kiln_view_maps_take_rows(struct kiln_view_maps *maps, struct kiln_point_dataset **rows)
{
    kiln_point_dataset_destroy(&maps->rows);
    maps->rows = *rows;
    *rows = NULL;
}

void kiln_view_maps_destroy(struct kiln_view_maps **maps)
{
    if (*maps == NULL)
        return;
    for (size_t i = 0; (*maps)->maps != NULL && i < 2 * (*maps)->source->scene->object_count; i++)
        kiln_image_destroy(&(*maps)->maps[i].image);
    kiln_free(&(*maps)->maps);
    kiln_leaf_light_destroy(&(*maps)->leaves);
    kiln_point_dataset_destroy(&(*maps)->rows);
    kiln_free(maps);
}

/* Whether the directions of light are needed besides the lightmaps. */
static bool needs_directions(const struct kiln_view_maps *maps)
{
    const struct kiln_view_source *s = maps->source;
    return maps->coarse == 0 && s->field == NULL && !s->texels && !s->no_normal_maps && s->scene->normal_map_count > 0;
}

/* Averages boxes of `every` x `every` texels; boxes at the edge may be smaller. */
static void average(const struct kiln_image *image, const float *const from[3], uint32_t every,
                    const struct kiln_image *small, float *const to[3])
{
    for (uint32_t y = 0; y < small->height; y++)
        for (uint32_t x = 0; x < small->width; x++)
            for (int c = 0; c < 3; c++) {
                double sum = 0.0;
                size_t count = 0;
                for (uint32_t v = y * every; v < (y + 1) * every && v < image->height; v++)
                    for (uint32_t u = x * every; u < (x + 1) * every && u < image->width; u++, count++)
                        sum += (double)from[c][(size_t)v * image->width + u];
                to[c][(size_t)y * small->width + x] = (float)(sum / (double)count);
            }
}

static int make_coarse(struct map *map, uint32_t side, struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    struct kiln_image *image = map->image, *small = NULL;
    const uint32_t longest = image->width > image->height ? image->width : image->height,
                   every = (longest + side - 1) / side;
    if (every <= 1)
        return KILN_OK;
    const int status = kiln_image_create(&small, (image->width + every - 1) / every,
                                         (image->height + every - 1) / every, names, 3, error);
    if (status != KILN_OK)
        return status;
    float *planes[3];
    (void)kiln_image_rgb(small, "", planes);
    average(image, map->planes, every, small, planes);
    kiln_image_destroy(&map->image);
    map->image = small;
    for (int c = 0; c < 3; c++)
        map->planes[c] = planes[c];
    map->scale_x = map->scale_y = 1.0f / (float)every;
    return KILN_OK;
}

/* Whether the bake is complete: run.json is written last. */
static bool is_whole(const char *directory)
{
    char path[KILN_PATH_SIZE];
    return kiln_path_join(path, directory, "run.json", NULL) == KILN_OK && access(path, F_OK) == 0;
}

/* Makes the name lightmaps/OBJECT.exr, or that of the backs, and its path. */
static int map_path(const struct kiln_view_maps *maps, uint32_t object, bool back, char name[KILN_PATH_SIZE],
                    char path[KILN_PATH_SIZE], struct kiln_error *error)
{
    const struct kiln_scene *scene = maps->source->scene;
    const int length = snprintf(name, KILN_PATH_SIZE, "lightmaps/%s%s.exr", back ? "back/" : "",
                                kiln_scene_string(scene, scene->objects[object].name));
    if (length < 0 || length >= KILN_PATH_SIZE || kiln_path_join(path, maps->source->directory, name, NULL) != KILN_OK)
        return kiln_fail(error, KILN_NO_INPUT, "the path of the lightmap of object %u is too long", object);
    return KILN_OK;
}

/* Finds `count` channels of an image; if it lacks one, planes[0] is NULL. */
static bool find_channels(const struct kiln_image *image, const char *const *names, size_t count, const float **planes)
{
    for (size_t c = 0; c < count; c++) {
        const struct kiln_image_channel *channel = kiln_image_find(image, names[c]);
        if (channel == NULL) {
            planes[0] = NULL;
            return false;
        }
        planes[c] = channel->values;
    }
    return true;
}

/* Finds the planes that are shown; false when the image lacks one. */
static bool find_planes(const struct kiln_view_source *source, struct map *map)
{
    const char *channels[CHANNELS];
    name_channels(channels);
    (void)find_channels(map->image, channels + LIGHT, SH, map->sh);
    (void)find_channels(map->image, channels + LIGHT + SH, DOMINANT, map->dominant);
    if (source->field == NULL)
        return find_channels(map->image, channels, LIGHT, map->planes);
    for (uint32_t c = 0; c < 3; c++) {
        const uint32_t last = source->field->components - 1;
        const struct kiln_image_channel *channel =
            kiln_image_find(map->image, source->field->channels[c < last ? c : last]);
        if (channel == NULL)
            return false;
        map->planes[c] = channel->values;
    }
    return true;
}

/* Lists the groups of lights that the bake separates; of many, only the first ones. */
static void list_groups(const struct kiln_view_source *source, char *list, size_t size)
{
    enum { FEW = 8 };
    struct kiln_error ignored;
    json_t *run = NULL;
    if (kiln_results_json(source->results, "run.json", &run, &ignored) != KILN_OK)
        return;
    const json_t *groups = json_object_get(run, "light_groups");
    for (size_t g = 0; g < json_array_size(groups) && g < FEW; g++) {
        const char *name = json_string_value(json_object_get(json_array_get(groups, g), "name"));
        const size_t used = strlen(list);
        (void)snprintf(list + used, size - used, ", group:%s", name != NULL ? name : "");
    }
    if (json_array_size(groups) > FEW)
        (void)snprintf(list + strlen(list), size - strlen(list), " and more groups");
    json_decref(run);
}

/* Fails with KILN_NO_INPUT: the lightmap `name` does not have the field to show. */
static int no_field(const struct kiln_view_source *source, const char *name, struct kiln_error *error)
{
    const struct kiln_field *fields[KILN_FIELDS_MAX];
    char list[1024] = "light";
    size_t count;
    const int status = kiln_results_fields(source->results, name, fields, &count, error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < count; i++) {
        const size_t used = strlen(list);
        (void)snprintf(list + used, sizeof list - used, ", %s", kiln_field_shown_name(fields[i]));
    }
    list_groups(source, list, sizeof list);
    return kiln_fail(error, KILN_NO_INPUT, "'%s/%s' has no layer '%s': this bake's lightmaps have %s",
                     source->directory, name, kiln_field_shown_name(source->field), list);
}

/* Makes a lightmap from a field's values in kiln.h5 at the object's points. */
static int load_points(struct kiln_view_maps *maps, uint32_t object, bool back, struct kiln_error *error)
{
    const struct kiln_view_source *s = maps->source;
    const struct kiln_object *o = &s->scene->objects[object];
    struct map *map = &maps->maps[object + (back ? s->scene->object_count : 0)];
    float *planes[3];
    int status = maps->rows != NULL ? KILN_OK
                                    : kiln_point_dataset_read(&maps->rows, s->results, s->field,
                                                              (uint32_t)s->scene->object_count, error);
    kiln_image_destroy(&map->image);
    if (status == KILN_OK)
        status =
            kiln_point_map_create(&map->image, maps->rows, object, back, o->lightmap_width, o->lightmap_height, error);
    if (status != KILN_OK)
        return status;
    (void)kiln_image_rgb(map->image, "", planes);
    for (int c = 0; c < 3; c++)
        map->planes[c] = planes[c];
    map->scale_x = map->scale_y = 1.0f;
    map->sparse = true;
    return KILN_OK;
}

static int load(struct kiln_view_maps *maps, uint32_t object, bool back, struct kiln_error *error)
{
    if (maps->source->field != NULL && maps->source->field->channels == NULL)
        return load_points(maps, object, back, error);
    const struct kiln_field *field = maps->source->field;
    const char *channels[CHANNELS];
    name_channels(channels);
    const char *const *wanted = field != NULL ? field->channels : channels;
    const size_t count = field != NULL ? field->components : needs_directions(maps) ? CHANNELS : LIGHT;
    const struct kiln_object *o = &maps->source->scene->objects[object];
    struct map *map = &maps->maps[object + (back ? maps->source->scene->object_count : 0)];
    char name[KILN_PATH_SIZE], path[KILN_PATH_SIZE];
    int status = map_path(maps, object, back, name, path, error);
    if (status == KILN_OK)
        status = maps->source->results != NULL
                     ? kiln_results_image(maps->source->results, name, wanted, count, &map->image, error)
                     : kiln_exr_read(path, wanted, count, &map->image, error);
    if (status == KILN_NO_INPUT && !is_whole(maps->source->directory))
        return kiln_fail(error, KILN_NO_INPUT,
                         "the bake in %s is not finished: it has no %s yet (kiln status %s says where it is)",
                         maps->source->directory, path + strlen(maps->source->directory) + 1, maps->source->directory);
    if (status != KILN_OK)
        return status;
    if (map->image->width != o->lightmap_width || map->image->height != o->lightmap_height ||
        (field == NULL && !find_planes(maps->source, map)))
        return kiln_fail(
            error, KILN_BAD_INPUT,
            "'%s' is not the lightmap of this scene's object: it has %u x %u texels, the scene says %u x %u", path,
            map->image->width, map->image->height, o->lightmap_width, o->lightmap_height);
    if (field != NULL && !find_planes(maps->source, map)) {
        status = load_points(maps, object, back, error);
        return status == KILN_NO_INPUT ? no_field(maps->source, name, error) : status;
    }
    map->scale_x = map->scale_y = 1.0f;
    return maps->coarse > 0 ? make_coarse(map, maps->coarse, error) : KILN_OK;
}

static bool has_back(const struct kiln_view_maps *maps, uint32_t object)
{
    char name[KILN_PATH_SIZE], path[KILN_PATH_SIZE];
    if (map_path(maps, object, true, name, path, NULL) != KILN_OK)
        return false;
    return maps->source->results != NULL ? kiln_results_has(maps->source->results, name) : access(path, F_OK) == 0;
}

int kiln_view_maps_load(struct kiln_view_maps *maps, const struct kiln_hit *hits, size_t count,
                        struct kiln_error *error)
{
    const size_t objects = maps->source->scene->object_count;
    int status = KILN_OK;
    if (maps->source->geometry->leaves != NULL)
        return maps->leaves != NULL ? KILN_OK : kiln_leaf_light_create(&maps->leaves, maps->source, error);
    for (size_t i = 0; status == KILN_OK && i < count; i++) {
        if (hits[i].triangle == KILN_NONE)
            continue;
        const uint32_t object = maps->source->geometry->records[hits[i].triangle].object;
        struct map *front = &maps->maps[object], *back = &maps->maps[object + objects];
        if ((maps->source->scene->objects[object].flags & KILN_OBJECT_CASTER_ONLY) != 0)
            continue;
        if (front->image == NULL)
            status = load(maps, object, false, error);
        if (status == KILN_OK && hits[i].back && !back->looked_for) {
            back->looked_for = true;
            status = has_back(maps, object) ? load(maps, object, true, error) : KILN_OK;
        }
    }
    return status;
}

/* x, but 0 at least and `most` at most. */
static inline float between(float x, float most)
{
    const float some = x > 0.0f ? x : 0.0f;
    return some < most ? some : most;
}

/* Values of the texel at a place. If it has no point, those of the nearest texel within `around` texels; if there is
 * none, NaN. */
static void look_up_nearest(const struct map *map, const float at[2], int around, float values[LIGHT])
{
    const struct kiln_image *image = map->image;
    const int x0 = (int)floorf(between(at[0], (float)(image->width - 1))),
              y0 = (int)floorf(between(at[1], (float)(image->height - 1)));
    float least = INFINITY;
    for (int c = 0; c < LIGHT; c++)
        values[c] = NAN;
    for (int y = y0 - around; y <= y0 + around; y++)
        for (int x = x0 - around; x <= x0 + around; x++) {
            const float dx = (float)x + 0.5f - at[0], dy = (float)y + 0.5f - at[1];
            const float far = x == x0 && y == y0 ? 0.0f : dx * dx + dy * dy;
            if (x < 0 || y < 0 || x >= (int)image->width || y >= (int)image->height || far >= least)
                continue;
            const size_t i = (size_t)y * image->width + (size_t)x;
            if (!isfinite(map->planes[0][i]))
                continue;
            least = far;
            for (int c = 0; c < LIGHT; c++)
                values[c] = map->planes[c][i];
        }
}

/* The mean of the four texels around a place that have a point, weighted bilinearly; NaN where none has. */
static void look_up_sparse(const struct map *map, const float at[2], float values[LIGHT])
{
    const struct kiln_image *image = map->image;
    const float fx = between(at[0] - 0.5f, (float)(image->width - 1)),
                fy = between(at[1] - 0.5f, (float)(image->height - 1));
    const uint32_t x0 = (uint32_t)fx, y0 = (uint32_t)fy;
    float sum[LIGHT] = {0.0f}, weights = 0.0f;
    for (uint32_t k = 0; k < 4; k++) {
        const uint32_t x = x0 + (k & 1u), y = y0 + (k >> 1);
        const float wx = 1.0f - fabsf(fx - (float)x), wy = 1.0f - fabsf(fy - (float)y);
        if (x >= image->width || y >= image->height || !(wx * wy > 0.0f))
            continue;
        const size_t i = (size_t)y * image->width + x;
        if (!isfinite(map->planes[0][i]))
            continue;
        weights += wx * wy;
        for (int c = 0; c < LIGHT; c++)
            sum[c] += wx * wy * map->planes[c][i];
    }
    for (int c = 0; c < LIGHT; c++)
        values[c] = weights > 0.0f ? sum[c] / weights : NAN;
}

/* The values of `count` planes at a place in the lightmap, in the scene's texels. */
static void look_up(const struct map *map, const float at[2], const float *const *planes, size_t count, float *values)
{
    const struct kiln_image *image = map->image;
    const float x = at[0] * map->scale_x, y = at[1] * map->scale_y;
    const float fx = between(x - 0.5f, (float)(image->width - 1)), fy = between(y - 0.5f, (float)(image->height - 1));
    const uint32_t x0 = (uint32_t)fx, y0 = (uint32_t)fy;
    const uint32_t x1 = x0 + 1 < image->width ? x0 + 1 : x0, y1 = y0 + 1 < image->height ? y0 + 1 : y0;
    const float wx = fx - (float)x0, wy = fy - (float)y0;
    for (size_t c = 0; c < count; c++) {
        const float *row0 = planes[c] + (size_t)y0 * image->width, *row1 = planes[c] + (size_t)y1 * image->width;
        values[c] =
            (1.0f - wy) * ((1.0f - wx) * row0[x0] + wx * row0[x1]) + wy * ((1.0f - wx) * row1[x0] + wx * row1[x1]);
    }
}

/* Light, or the field shown, at a place in the lightmap. A texel at the edge of a surface may have no point: then the
 * value of a neighbour at most `around` texels away. */
static void look_up_light(const struct kiln_view_source *source, const struct map *map, const float at[2], int around,
                          float rgb[3])
{
    if (!source->nearest && !map->sparse)
        look_up(map, at, map->planes, LIGHT, rgb);
    else if (!source->nearest)
        look_up_sparse(map, at, rgb);
    if (source->nearest || (map->sparse && around > 0 && !isfinite(rgb[0])))
        look_up_nearest(map, at, around, rgb);
}

static const struct map *map_of(const struct kiln_view_maps *maps, const struct kiln_hit *hit)
{
    const uint32_t object = maps->source->geometry->records[hit->triangle].object;
    const struct map *back = &maps->maps[object + maps->source->scene->object_count];
    return hit->back && back->image != NULL ? back : &maps->maps[object];
}

bool kiln_view_shows_front(const struct kiln_view_maps *maps, const struct kiln_hit *hit)
{
    float rgb[3];
    if (maps->leaves != NULL)
        return hit->back && !kiln_leaf_light_at(maps->leaves, maps->source->geometry, hit, true, rgb);
    return hit->back && map_of(maps, hit) == &maps->maps[maps->source->geometry->records[hit->triangle].object];
}

/* The hit's place in its object's lightmap, texels. */
static void place_of(const struct kiln_view_maps *maps, const struct kiln_hit *hit, float at[2])
{
    const struct kiln_hit_record *record = &maps->source->geometry->records[hit->triangle];
    at[0] = kiln_hit_x(record, hit->u, hit->v);
    at[1] = kiln_hit_y(record, hit->u, hit->v);
}

void kiln_view_irradiance(const struct kiln_view_maps *maps, const struct kiln_hit *hit, float rgb[3])
{
    const struct map *map = map_of(maps, hit);
    float at[2];
    if (maps->leaves != NULL) {
        if (!hit->back || !kiln_leaf_light_at(maps->leaves, maps->source->geometry, hit, true, rgb))
            (void)kiln_leaf_light_at(maps->leaves, maps->source->geometry, hit, false, rgb);
        return;
    }
    place_of(maps, hit, at);
    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    if (map->image != NULL)
        look_up_light(maps->source, map, at, 1, rgb);
}

int kiln_view_maps_load_object(struct kiln_view_maps *maps, uint32_t object, struct kiln_error *error)
{
    return maps->maps[object].image == NULL ? load(maps, object, false, error) : KILN_OK;
}

void kiln_view_map_at(const struct kiln_view_maps *maps, uint32_t object, const float at[2], float rgb[3])
{
    look_up_light(maps->source, &maps->maps[object], at, 0, rgb);
}

/* Applies the material's normal map to irradiance. */
static void apply_normal_map(const struct kiln_view_maps *maps, const struct kiln_hit *hit, uint64_t stored,
                             float rgb[3], struct kiln_view_seen *seen)
{
    const struct kiln_view_source *s = maps->source;
    const struct map *map = map_of(maps, hit);
    const struct kiln_normal_map *normals = kiln_normal_map_of(s->scene, stored);
    if (s->no_normal_maps || normals == NULL || map->image == NULL)
        return;
    seen->mapped = map->sh[0] != NULL || map->dominant[0] != NULL ? 1.0f : 0.0f;
    seen->flat = 1.0f - seen->mapped;
    if (seen->flat != 0.0f)
        return;
    struct kiln_dvec3 n = dvec3_of(kiln_triangle_shading_normal(s->scene, s->geometry, hit->triangle, hit->u, hit->v));
    struct kiln_dvec3 m = kiln_normal_map_apply(s->scene, s->geometry, normals, hit->triangle, hit->u, hit->v, n);
    if (hit->back && !kiln_view_shows_front(maps, hit)) { /* seen from behind, bumps of the front are dents */
        n = dvec3_scale(n, -1.0);
        m = dvec3_scale(m, -1.0);
    }
    float at[2], sh[SH], dominant[DOMINANT];
    place_of(maps, hit, at);
    if (map->sh[0] != NULL)
        look_up(map, at, map->sh, SH, sh);
    else
        look_up(map, at, map->dominant, DOMINANT, dominant);
    for (int c = 0; c < 3; c++)
        rgb[c] *= (float)(map->sh[0] != NULL
                              ? kiln_normal_factor_sh((const float[]){sh[c], sh[3 + c], sh[6 + c], sh[9 + c]}, n, m)
                              : kiln_normal_factor_dominant(
                                    dvec3((double)dominant[0], (double)dominant[1], (double)dominant[2]),
                                    (double)dominant[3], n, m));
}

/* ---- texels ---- */

/* The colour in a checkerboard of the object's texels: one square for each texel, a hue for each object, darker at
 * grazing angles. */
static void texel_color(const struct kiln_view_source *s, const struct kiln_hit *hit, struct kiln_vec3 direction,
                        float rgb[3])
{
    const struct kiln_hit_record *record = &s->geometry->records[hit->triangle];
    const float at[2] = {kiln_hit_x(record, hit->u, hit->v), kiln_hit_y(record, hit->u, hit->v)};
    const float slant = 0.4f + 0.6f * fabsf(vec3_dot(kiln_triangle_normal(s->geometry, hit->triangle), direction));
    kiln_view_texel_color(record->object, at, rgb);
    for (int c = 0; c < 3; c++)
        rgb[c] *= slant;
}

void kiln_view_texel_color(uint32_t object, const float at[2], float rgb[3])
{
    const float square = fmodf(fabsf(floorf(at[0]) + floorf(at[1])), 2.0f) == 0.0f ? 0.8f : 0.25f;
    for (uint32_t c = 0; c < 3; c++)
        rgb[c] = square * (0.75f + 0.25f * kiln_unit_float(kiln_hash2(object, c)));
}

/* ---- colour ---- */

/* Multiplies by the tint of the glass that the ray went through before its hit. */
static void tint(const struct kiln_hit *hit, float rgb[3])
{
    for (int c = 0; c < 3; c++)
        rgb[c] *= hit->tint[c];
}

void kiln_view_lit(const struct kiln_view_maps *maps, const struct kiln_hit *hit, const float irradiance[3],
                   float rgb[3])
{
    const struct kiln_view_source *s = maps->source;
    const struct kiln_mesh *mesh =
        &s->scene->meshes[s->scene->objects[s->geometry->records[hit->triangle].object].mesh];
    const uint64_t stored = s->geometry->stored_triangle[hit->triangle];
    float color[4], emission[3], b1, b2;
    kiln_geometry_stored_barycentrics(s->scene, s->geometry, hit->triangle, hit->u, hit->v, &b1, &b2);
    kiln_surface_base_color(s->scene, mesh, stored, b1, b2, color);
    kiln_surface_emission(s->scene, mesh, stored, b1, b2, emission);
    for (int c = 0; c < 3; c++)
        rgb[c] = color[c] * irradiance[c] * (float)(1.0 / KILN_PI) + emission[c];
}

void kiln_view_emission(const struct kiln_view_maps *maps, const struct kiln_hit *hit, float rgb[3])
{
    const struct kiln_view_source *s = maps->source;
    const struct kiln_mesh *mesh =
        &s->scene->meshes[s->scene->objects[s->geometry->records[hit->triangle].object].mesh];
    float b1, b2;
    kiln_geometry_stored_barycentrics(s->scene, s->geometry, hit->triangle, hit->u, hit->v, &b1, &b2);
    kiln_surface_emission(s->scene, mesh, s->geometry->stored_triangle[hit->triangle], b1, b2, rgb);
}

/* Values of the field shown. Where there are none: NaN if the colours have a range, else 0. */
static void field_color(const struct kiln_view_maps *maps, const struct kiln_hit *hit, struct kiln_view_seen *seen)
{
    const enum kiln_field_meaning meaning = maps->source->field->meaning;
    const bool is_seen = kiln_view_is_seen(maps->source, hit);
    if (is_seen) {
        kiln_view_irradiance(maps, hit, seen->rgb);
        seen->front_light = kiln_view_shows_front(maps, hit) ? 1.0f : 0.0f;
    }
    if (is_seen && maps->source->voxels != NULL)
        kiln_voxel_view_place(maps->source, seen->rgb);
    for (int c = 0; c < 3; c++)
        if (!is_seen || !isfinite(seen->rgb[c]))
            seen->rgb[c] = meaning == KILN_FIELD_SCALE || meaning == KILN_FIELD_PLACE ? NAN : 0.0f;
}

void kiln_view_radiance(const struct kiln_view_maps *maps, const struct kiln_hit *hit, struct kiln_vec3 direction,
                        struct kiln_view_seen *seen)
{
    const struct kiln_view_source *s = maps->source;
    *seen = (struct kiln_view_seen){.irradiance = {-1.0f, -1.0f, -1.0f}};
    if (s->texels && kiln_view_is_seen(s, hit)) {
        texel_color(s, hit, direction, seen->rgb);
        return;
    }
    if (s->field != NULL) {
        field_color(maps, hit, seen);
        return;
    }
    if (!kiln_view_is_seen(s, hit)) {
        if (s->lights != NULL)
            kiln_environment_radiance(s->lights, dvec3_of(direction), seen->rgb);
        tint(hit, seen->rgb);
        return;
    }
    const uint64_t stored = s->geometry->stored_triangle[hit->triangle];
    float irradiance[3];
    kiln_view_irradiance(maps, hit, irradiance);
    apply_normal_map(maps, hit, stored, irradiance, seen);
    kiln_view_lit(maps, hit, irradiance, seen->rgb);
    seen->metal = s->scene->materials[s->scene->triangle_materials[stored]].metallic;
    seen->front_light = kiln_view_shows_front(maps, hit) ? 1.0f : 0.0f;
    if (!(hit->tint[0] < 1.0f || hit->tint[1] < 1.0f || hit->tint[2] < 1.0f))
        memcpy(seen->irradiance, irradiance, sizeof irradiance);
    tint(hit, seen->rgb);
}
