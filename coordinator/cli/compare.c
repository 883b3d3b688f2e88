/* kiln compare: compares two lightmaps, or all lightmaps of two bakes. If lightmaps differ in size, or a bake has
 * octrees, they are compared at sample points on the surfaces. */
#include "coordinator/view/compare.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <jansson.h>

#include "coordinator/cli/commands.h"
#include "coordinator/cli/compare_area.h"
#include "coordinator/files/json.h"
#include "coordinator/files/output_name.h"
#include "coordinator/view/compare_surface.h"
#include "coordinator/output/image.h"
#include "coordinator/output/read/results.h"
#include "coordinator/field/units.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

struct one {
    char name[256]; /* lightmap's file name, or object's name with octrees; empty if two files are compared */
    struct kiln_difference difference;
    double worst_place[3];       /* position, m; only if sampled */
    uint32_t object_a, object_b; /* only if sampled */
};

struct comparison {
    const char *a, *b;
    struct one *ones;
    size_t count, capacity;
    struct kiln_difference total;
    size_t worst;                                     /* index of the image with the worst texel */
    struct kiln_results *results_a, *results_b;       /* if folders are compared */
    struct kiln_reader *reader;                       /* if files are compared */
    struct kiln_scene *scene_a, *scene_b;             /* not NULL: the bakes are compared at sample points */
    struct kiln_compared_leaves *leaves_a, *leaves_b; /* of bakes with octrees; else NULL */
    /* whether both bakes have the same leaves, and the same light in them */
    bool same_leaves, same_light;
    double area; /* of all objects, m2; only if sampled */
};

/* Number of sample points on all objects, and the least number on an object. */
enum { SAMPLES = 1 << 20, SAMPLES_LEAST = 1024 };

/* ---- comparing ---- */

static int is_folder(const char *path, bool *folder, struct kiln_error *error)
{
    struct stat found;
    if (stat(path, &found) != 0)
        return kiln_fail_errno(error, 0, "'%s' cannot be compared", path);
    *folder = S_ISDIR(found.st_mode);
    return KILN_OK;
}

static int read_pair(const struct comparison *c, size_t k, struct kiln_image **a, struct kiln_image **b,
                     struct kiln_error *error)
{
    char name[300];
    *a = *b = NULL;
    const bool octrees = c->leaves_a != NULL || c->leaves_b != NULL;
    int status = KILN_OK;
    if (c->ones[k].name[0] == '\0') {
        status = kiln_reader_image_at(c->reader, c->a, a, error);
        return status == KILN_OK ? kiln_reader_image_at(c->reader, c->b, b, error) : status;
    }
    (void)snprintf(name, sizeof name, "lightmaps/%s%s", c->ones[k].name, octrees ? ".exr" : "");
    if (c->leaves_a == NULL)
        status = kiln_results_image(c->results_a, name, NULL, 0, a, error);
    if (status == KILN_OK && c->leaves_b == NULL)
        status = kiln_results_image(c->results_b, name, NULL, 0, b, error);
    return status;
}

/* Compares an object at sample points on its surface, each of which represents an equal part of the area. */
static int compare_sampled(const struct comparison *c, struct one *one, const struct kiln_image *a,
                           const struct kiln_image *b, struct kiln_error *error)
{
    const struct kiln_compared in_a = {c->scene_a, one->object_a, a, c->leaves_a},
                               in_b = {c->scene_b, one->object_b, b, c->leaves_b};
    const double share = c->area > 0.0 ? kiln_object_area(c->scene_a, one->object_a) / c->area : 0.0;
    struct kiln_samples samples;
    int status = kiln_samples_take(&samples, &in_a, &in_b, (size_t)fmax(SAMPLES_LEAST, SAMPLES * share), error);
    if (status != KILN_OK)
        return status;
    status = kiln_compare_images(samples.a, samples.b, &one->difference, error);
    if (status == KILN_OK) {
        one->difference.identical = c->same_light;
        one->difference.weight = samples.area / (double)samples.count;
        memcpy(one->worst_place, samples.positions[one->difference.worst_x], sizeof one->worst_place);
    }
    kiln_samples_destroy(&samples);
    return status;
}

static int compare_one(struct comparison *c, size_t k, struct kiln_error *error)
{
    struct kiln_image *a, *b;
    struct kiln_error inner = {{0}};
    int status = read_pair(c, k, &a, &b, error);
    if (status == KILN_OK) {
        status = c->scene_a != NULL ? compare_sampled(c, &c->ones[k], a, b, &inner)
                                    : kiln_compare_images(a, b, &c->ones[k].difference, &inner);
        if (status != KILN_OK)
            (void)kiln_fail(error, status, "%s%s%s", c->ones[k].name, c->ones[k].name[0] == '\0' ? "" : ": ",
                            inner.message);
    }
    kiln_image_destroy(&a);
    kiln_image_destroy(&b);
    return status;
}

static int add_one(struct comparison *c, const char *name, struct kiln_error *error)
{
    const int status = kiln_grow(&c->ones, &c->capacity, c->count + 1, sizeof *c->ones, "lightmaps to compare", error);
    if (status != KILN_OK)
        return status;
    memset(&c->ones[c->count], 0, sizeof c->ones[c->count]);
    (void)snprintf(c->ones[c->count++].name, sizeof c->ones->name, "%.255s", name);
    return KILN_OK;
}

static int compare_names(const void *a, const void *b)
{
    return strcmp(((const struct one *)a)->name, ((const struct one *)b)->name);
}

static int open_list(const struct kiln_results *results, const char *name, const char *directory, DIR **folder,
                     struct kiln_error *error)
{
    int descriptor;
    struct kiln_error why = {""};
    const int status = kiln_results_folder(results, name, &descriptor, &why);
    if (status != KILN_OK)
        return kiln_fail(error, status, "'%s' is not the folder of a bake: %s", directory, why.message);
    *folder = fdopendir(descriptor);
    if (*folder != NULL)
        return KILN_OK;
    (void)close(descriptor);
    return kiln_fail_errno(error, KILN_SYSTEM, "'%s/%s' cannot be read", directory, name);
}

static bool is_lightmap(const char *name)
{
    const size_t length = strlen(name);
    return name[0] != '.' && length > 4 && strcmp(name + length - 4, ".exr") == 0;
}

/* Whether an entry of lightmaps/ is the folder of a part of the scene. */
static bool is_part(const DIR *folder, const char *name)
{
    struct stat status;
    return name[0] != '.' && strcmp(name, "back") != 0 && strncmp(name, "groups-", 7) != 0 &&
           fstatat(dirfd((DIR *)(uintptr_t)folder), name, &status, AT_SYMLINK_NOFOLLOW) == 0 && S_ISDIR(status.st_mode);
}

/* Lists the lightmaps of a part of the scene. */
static int list_part(struct comparison *c, const struct kiln_results *results, const char *part, const char *directory,
                     struct kiln_error *error)
{
    char name[300], file[2 * NAME_MAX + 2];
    DIR *folder;
    const struct dirent *entry;
    (void)snprintf(name, sizeof name, "lightmaps/%.255s", part);
    int status = open_list(results, name, directory, &folder, error);
    if (status != KILN_OK)
        return status;
    while (status == KILN_OK && (entry = readdir(folder)) != NULL) {
        const int length = snprintf(file, sizeof file, "%s/%s", part, entry->d_name);
        if (is_lightmap(entry->d_name) && (size_t)length < sizeof c->ones->name)
            status = add_one(c, file, error);
    }
    (void)closedir(folder);
    return status;
}

/* Lists the names of the lightmaps in the folder of a bake, in byte order. */
static int list_lightmaps(struct comparison *c, const struct kiln_results *results, const char *directory,
                          struct kiln_error *error)
{
    DIR *folder;
    const struct dirent *entry;
    int status = open_list(results, "lightmaps", directory, &folder, error);
    if (status != KILN_OK)
        return status;
    while (status == KILN_OK && (entry = readdir(folder)) != NULL) {
        if (is_lightmap(entry->d_name) && strlen(entry->d_name) < sizeof c->ones->name)
            status = add_one(c, entry->d_name, error);
        else if (is_part(folder, entry->d_name))
            status = list_part(c, results, entry->d_name, directory, error);
    }
    (void)closedir(folder);
    if (status == KILN_OK && c->count > 0)
        qsort(c->ones, c->count, sizeof *c->ones, compare_names);
    return status;
}

static void close_scenes(struct comparison *c)
{
    kiln_scene_close(&c->scene_a);
    kiln_scene_close(&c->scene_b);
}

/* Opens both scenes, and the leaves of the bakes that have octrees; without any, closes the scenes again. */
static int open_leaves(struct comparison *c, struct kiln_error *error)
{
    if (!kiln_results_has(c->results_a, "scene.kscene") || !kiln_results_has(c->results_b, "scene.kscene"))
        return KILN_OK;
    int status;
    KILN_TRY(kiln_results_scene(c->results_a, &c->scene_a, error));
    KILN_TRY(kiln_results_scene(c->results_b, &c->scene_b, error));
    KILN_TRY(kiln_compared_leaves_open(&c->leaves_a, c->results_a, c->scene_a, c->a, error));
    KILN_TRY(kiln_compared_leaves_open(&c->leaves_b, c->results_b, c->scene_b, c->b, error));
end:
    if (status != KILN_OK || (c->leaves_a == NULL && c->leaves_b == NULL)) {
        close_scenes(c);
    } else if (c->leaves_a != NULL && c->leaves_b != NULL) {
        c->same_light = kiln_compared_leaves_same(c->leaves_a, c->leaves_b, true);
        c->same_leaves = c->same_light || kiln_compared_leaves_same(c->leaves_a, c->leaves_b, false);
    }
    if (c->same_leaves) {
        kiln_compared_leaves_alone(c->leaves_a);
        kiln_compared_leaves_alone(c->leaves_b);
    }
    return status;
}

/* Lists the objects of a scene that have light. */
static int list_objects(struct comparison *c, const struct kiln_scene *scene, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < scene->object_count; i++)
        if ((scene->objects[i].flags & KILN_OBJECT_CASTER_ONLY) == 0)
            KILN_TRY(add_one(c, kiln_scene_string(scene, scene->objects[i].name), error));
    if (c->count > 0)
        qsort(c->ones, c->count, sizeof *c->ones, compare_names);
end:
    return status;
}

/* Lists the lightmaps or, of bakes with octrees, the objects of both folders, which must have the same names; a
 * lightmap that is missing on one side is an error. */
static int list_pairs(struct comparison *c, struct kiln_error *error)
{
    struct comparison other = {0};
    int status;
    KILN_TRY(kiln_results_open(&c->results_a, c->a, error));
    KILN_TRY(kiln_results_open(&c->results_b, c->b, error));
    KILN_TRY(open_leaves(c, error));
    const bool octrees = c->leaves_a != NULL || c->leaves_b != NULL;
    KILN_TRY(octrees ? list_objects(c, c->scene_a, error) : list_lightmaps(c, c->results_a, c->a, error));
    KILN_TRY(octrees ? list_objects(&other, c->scene_b, error) : list_lightmaps(&other, c->results_b, c->b, error));
    for (size_t i = 0; i < c->count || i < other.count; i++) {
        const int order = i >= c->count ? 1 : i >= other.count ? -1 : strcmp(c->ones[i].name, other.ones[i].name);
        if (order != 0)
            KILN_TRY(kiln_fail(error, KILN_BAD_INPUT,
                               "%s '%s' is in '%s' but not in '%s': these are not bakes of the same scene",
                               octrees ? "object" : "lightmap", order < 0 ? c->ones[i].name : other.ones[i].name,
                               order < 0 ? c->a : c->b, order < 0 ? c->b : c->a));
    }
    if (c->count == 0)
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT, "there are no lightmaps in '%s/lightmaps' and '%s/lightmaps'", c->a,
                           c->b));
end:
    kiln_free(&other.ones);
    return status;
}

/* The object whose name and `ending` make up `name`: that of a lightmap, or of the object itself. */
static int find_object(const struct kiln_scene *scene, const char *name, const char *ending, const char *directory,
                       uint32_t *object, struct kiln_error *error)
{
    for (*object = 0; *object < scene->object_count; (*object)++) {
        const char *own = kiln_scene_string(scene, scene->objects[*object].name);
        if (strncmp(own, name, strlen(own)) == 0 && strcmp(name + strlen(own), ending) == 0)
            return KILN_OK;
    }
    return kiln_fail(error, KILN_BAD_INPUT, "'%s/scene.kscene' has no object for the lightmap '%s'", directory, name);
}

/* Opens the scenes of both bakes. Keeps them open, to compare at sample points, if any lightmap differs in size or a
 * bake has an octree. Without scene files lightmaps are compared texel by texel. */
static int decide_how(struct comparison *c, struct kiln_error *error)
{
    bool same = c->leaves_a == NULL && c->leaves_b == NULL;
    const char *ending = same ? ".exr" : "";
    int status = KILN_OK;
    if (!kiln_results_has(c->results_a, "scene.kscene") || !kiln_results_has(c->results_b, "scene.kscene"))
        return KILN_OK;
    if (c->scene_a == NULL)
        status = kiln_results_scene(c->results_a, &c->scene_a, error);
    if (status == KILN_OK && c->scene_b == NULL)
        status = kiln_results_scene(c->results_b, &c->scene_b, error);
    for (size_t k = 0; status == KILN_OK && k < c->count; k++) {
        struct one *one = &c->ones[k];
        status = find_object(c->scene_a, one->name, ending, c->a, &one->object_a, error);
        if (status == KILN_OK)
            status = find_object(c->scene_b, one->name, ending, c->b, &one->object_b, error);
        if (status != KILN_OK)
            break;
        const struct kiln_object *a = &c->scene_a->objects[one->object_a], *b = &c->scene_b->objects[one->object_b];
        same = same && a->lightmap_width == b->lightmap_width && a->lightmap_height == b->lightmap_height;
        c->area += kiln_object_area(c->scene_a, one->object_a);
    }
    if (same || status != KILN_OK)
        close_scenes(c);
    return status;
}

/* Computes dfpr_8bit of several lightmaps, scaled by the largest light of all of them. */
static int compare_codes(struct comparison *c, struct kiln_error *error)
{
    const double largest = c->total.largest;
    int status = KILN_OK;
    c->total = (struct kiln_difference){.identical = true};
    for (size_t k = 0; status == KILN_OK && k < c->count; k++) {
        struct kiln_image *a, *b;
        status = read_pair(c, k, &a, &b, error);
        if (status == KILN_OK)
            status = kiln_compare_codes(a, b, largest, &c->ones[k].difference, error);
        if (status == KILN_OK)
            kiln_difference_add(&c->total, &c->ones[k].difference);
        kiln_image_destroy(&a);
        kiln_image_destroy(&b);
    }
    return status;
}

static int compare_all(struct comparison *c, struct kiln_error *error)
{
    bool folder_a = false, folder_b = false;
    int status;
    KILN_TRY(is_folder(c->a, &folder_a, error));
    KILN_TRY(is_folder(c->b, &folder_b, error));
    if (folder_a != folder_b)
        KILN_TRY(kiln_fail(error, KILN_USAGE, "'%s' is a folder and '%s' is not: compare two bakes or two EXR files",
                           folder_a ? c->a : c->b, folder_a ? c->b : c->a));
    KILN_TRY(folder_a ? list_pairs(c, error) : add_one(c, "", error));
    if (!folder_a)
        KILN_TRY(kiln_reader_create(&c->reader, 0, error));
    if (folder_a)
        KILN_TRY(decide_how(c, error));
end:
    c->total = (struct kiln_difference){.identical = true};
    for (size_t k = 0; status == KILN_OK && k < c->count; k++) {
        status = compare_one(c, k, error);
        if (status != KILN_OK)
            break;
        if (c->ones[k].difference.worst > c->ones[c->worst].difference.worst)
            c->worst = k;
        kiln_difference_add(&c->total, &c->ones[k].difference);
    }
    /* a comparison at sample points has no pixels */
    return status == KILN_OK && c->count > 1 && c->scene_a == NULL ? compare_codes(c, error) : status;
}

/* ---- output ---- */

static json_t *number_json(double value) { return isfinite(value) ? json_real(value) : json_null(); }

static json_t *difference_json(const struct kiln_difference *d)
{
    json_t *channels = json_object();
    for (uint32_t c = 0; c < d->channel_count; c++)
        json_object_set_new(channels, d->channels[c].name,
                            json_pack("{s:f, s:f, s:f}", "rmse", d->channels[c].rmse, "mean_difference",
                                      d->channels[c].mean_difference, "mean", d->channels[c].mean));
    return json_pack(
        "{s:b, s:I, s:I, s:I, s:f, s:f, s:o, s:f, s:o, s:f, s:o, s:o, s:f, s:f, s:f, s:{s:f, s:i, s:i}, s:o}",
        "identical", d->identical, "texels", (json_int_t)d->texels, "interior_texels", (json_int_t)d->interior,
        "not_finite", (json_int_t)d->not_finite, "mean", d->mean, "rmse", d->rmse, "nrmse", number_json(d->nrmse),
        "rel_rmse", d->rel_rmse, "psnr", number_json(d->psnr), "dssim", d->dssim, "picture_psnr",
        number_json(d->picture_psnr), "picture_dissimilarity", number_json(d->picture_dissimilarity), "dfpr", d->dfpr,
        "dfpr_unit", d->dfpr_unit, "dfpr_8bit", d->dfpr_8bit, "worst", "difference", d->worst, "x", (int)d->worst_x,
        "y", (int)d->worst_y, "channels", channels);
}

/* Adapts the JSON object to sample points: adds the worst place, and removes the measures that need neighbouring pixels
 * or pictures. */
static void add_place(const struct comparison *c, json_t *root)
{
    static const char *const of_pictures[] = {"dssim", "picture_psnr", "picture_dissimilarity", "dfpr_8bit"};
    const double *place = c->ones[c->worst].worst_place;
    if (c->scene_a == NULL)
        return;
    for (size_t i = 0; i < sizeof of_pictures / sizeof *of_pictures; i++)
        json_object_set_new(root, of_pictures[i], json_null());
    json_object_set_new(json_object_get(root, "worst"), "position", json_pack("[f,f,f]", place[0], place[1], place[2]));
    json_object_del(json_object_get(root, "worst"), "x");
    json_object_del(json_object_get(root, "worst"), "y");
}

static int print_json(const struct comparison *c, struct kiln_error *error)
{
    json_t *root = difference_json(&c->total);
    if (root != NULL) {
        json_object_set_new(root, "status", json_string("done"));
        json_object_set_new(root, "a", json_string(c->a));
        json_object_set_new(root, "b", json_string(c->b));
        json_object_set_new(root, "sampled", json_boolean(c->scene_a != NULL));
        if (c->results_a != NULL && kiln_results_has(c->results_a, "scene.kscene"))
            json_object_set_new(root, "by_area", kiln_compare_by_area(c->results_a, c->results_b));
        add_place(c, root);
    }
    json_t *objects = json_object();
    for (size_t k = 0; k < c->count && c->ones[k].name[0] != '\0'; k++)
        json_object_set_new(objects, c->ones[k].name, difference_json(&c->ones[k].difference));
    if (json_object_size(objects) > 0) {
        json_object_set_new(json_object_get(root, "worst"),
                            c->leaves_a != NULL || c->leaves_b != NULL ? "object" : "lightmap",
                            json_string(c->ones[c->worst].name));
        json_object_set(root, c->leaves_a != NULL || c->leaves_b != NULL ? "objects" : "lightmaps", objects);
    }
    json_decref(objects);
    return kiln_json_print(root, error);
}

static void print_text(const struct comparison *c)
{
    const struct kiln_difference *d = &c->total;
    const double *place = c->ones[c->worst].worst_place;
    const char *unit = c->results_b != NULL ? kiln_units_of_bake(c->results_b)->irradiance_text : "W/m2";
    (void)printf("%s\n", d->identical ? "bit-identical" : "different");
    if (c->scene_a != NULL)
        (void)printf("sampled    at points spread over the surfaces by area, %s\n",
                     c->same_leaves                               ? "each for the leaf that it lies in"
                     : c->leaves_a != NULL && c->leaves_b != NULL ? "between leaves, since these differ"
                     : c->leaves_a != NULL || c->leaves_b != NULL ? "since one bake has leaves and the other lightmaps"
                                                                  : "since the lightmaps differ in size");
    (void)printf("%s     %llu valid in both, %llu of them wholly inside charts\n",
                 c->scene_a != NULL ? "places" : "texels", (unsigned long long)d->texels,
                 (unsigned long long)d->interior);
    if (d->not_finite > 0)
        (void)printf("left out   %llu texels that are not finite numbers\n", (unsigned long long)d->not_finite);
    (void)printf("mean       %.6g %s (reference)\n", d->mean, unit);
    (void)printf("rmse       %.6g %s\n", d->rmse, unit);
    if (isfinite(d->nrmse))
        (void)printf("nrmse      %.4f %% of the mean, wholly inside charts\n", 100.0 * d->nrmse);
    else
        (void)puts("nrmse      - (no lit texel wholly inside charts)");
    (void)printf("rel-rmse   %.4f %%\n", 100.0 * d->rel_rmse);
    (void)printf("psnr       %.2f dB\n", d->psnr);
    if (c->scene_a == NULL)
        (void)printf("dssim      %.6g\npicture    psnr %.2f dB, 1 / ssim - 1 %.6g (tone-mapped, 8 bits)\n", d->dssim,
                     d->picture_psnr, d->picture_dissimilarity);
    (void)printf("dfpr       %.6g %s; %.6g with the brightest value as 1", d->dfpr, unit, d->dfpr_unit);
    if (c->scene_a == NULL)
        (void)printf("; %.6g of 8 bits and all pixels", d->dfpr_8bit);
    (void)puts("");
    if (c->scene_a != NULL)
        kiln_print(stdout, "worst      %.6g %s at %.6g %.6g %.6g on %s\n", d->worst, unit, place[0], place[1], place[2],
                   c->ones[c->worst].name);
    else
        kiln_print(stdout, "worst      %.6g %s at texel (%u, %u)%s%s\n", d->worst, unit, d->worst_x, d->worst_y,
                   c->ones[c->worst].name[0] == '\0' ? "" : " of ", c->ones[c->worst].name);
    for (uint32_t i = 0; i < d->channel_count; i++)
        kiln_print(stdout, "  %-12s rmse %.6g, mean of the difference %.6g, mean %.6g\n", d->channels[i].name,
                   d->channels[i].rmse, d->channels[i].mean_difference, d->channels[i].mean);
}

/* Writes a picture of the lightmap with the worst texel; full scale is 10 % of the reference's mean. */
static int write_picture(const struct comparison *c, const char *path, struct kiln_error *error)
{
    struct kiln_image *a, *b;
    uint8_t *bytes = NULL;
    if (c->scene_a != NULL)
        return kiln_fail(error, KILN_USAGE,
                         "--output %s: there is no picture of %s; without it the numbers are printed", path,
                         c->leaves_a != NULL || c->leaves_b != NULL ? "octrees" : "lightmaps that differ in size");
    int status;
    KILN_TRY(read_pair(c, c->worst, &a, &b, error));
    KILN_TRY(kiln_allocate(&bytes, (size_t)a->width * a->height * 3, 1, "a picture", error));
    KILN_TRY(kiln_difference_picture(a, b, 0.1, bytes, error));
    KILN_TRY(kiln_png_write_bytes(NULL, path, bytes, a->width, a->height,
                                  "difference of two lightmaps: black none, white 10 % of the mean and more", error));
end:
    kiln_free(&bytes);
    kiln_image_destroy(&a);
    kiln_image_destroy(&b);
    return status;
}

int kiln_command_compare(struct kiln_job *job, struct kiln_error *error)
{
    struct comparison c = {.a = job->arguments[0], .b = job->arguments[1]};
    const struct kiln_output_name name = {
        .option = "--output", .path = job->output, .inputs = {c.a, c.b}, .bakes = {c.a, c.b}};
    int status;
    KILN_TRY(job->output != NULL ? kiln_output_name_check(&name, error) : KILN_OK);
    KILN_TRY(compare_all(&c, error));
    if (job->output != NULL)
        KILN_TRY(write_picture(&c, job->output, error));
    if (job->json)
        KILN_TRY(print_json(&c, error));
    else if (!job->quiet)
        print_text(&c);
end:
    kiln_compared_leaves_close(&c.leaves_a);
    kiln_compared_leaves_close(&c.leaves_b);
    close_scenes(&c);
    kiln_reader_destroy(&c.reader);
    kiln_results_close(&c.results_a);
    kiln_results_close(&c.results_b);
    kiln_free(&c.ones);
    return status;
}
