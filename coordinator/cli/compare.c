/* kiln compare: two lightmaps, or all lightmaps of two bakes. */
#include "coordinator/output/compare.h"

#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include <jansson.h>

#include "coordinator/cli/commands.h"
#include "coordinator/cli/json.h"
#include "coordinator/output/exr.h"
#include "coordinator/output/publish.h"
#include "worker/base/memory.h"

struct one {
    char name[256]; /* of the lightmap's file; empty for two files */
    struct kiln_difference difference;
};

struct comparison {
    const char *a, *b;
    struct one *ones;
    size_t count, capacity;
    struct kiln_difference total;
    size_t worst; /* the image with the worst texel */
};

/* ---- comparing ---- */

static int is_folder(const char *path, bool *folder, struct kiln_error *error)
{
    struct stat found;
    if (stat(path, &found) != 0)
        return kiln_fail_errno(error, 0, "'%s' cannot be compared", path);
    *folder = S_ISDIR(found.st_mode);
    return KILN_OK;
}

/* Paths of the k-th image of both. */
static int image_paths(const struct comparison *c, size_t k, char a[KILN_PATH_SIZE], char b[KILN_PATH_SIZE], struct kiln_error *error)
{
    char name[300];
    if (c->ones[k].name[0] == '\0') {
        const bool fits = snprintf(a, KILN_PATH_SIZE, "%s", c->a) < KILN_PATH_SIZE && snprintf(b, KILN_PATH_SIZE, "%s", c->b) < KILN_PATH_SIZE;
        return fits ? KILN_OK : kiln_fail(error, KILN_USAGE, "a path to compare is longer than %d bytes", KILN_PATH_SIZE - 1);
    }
    (void)snprintf(name, sizeof name, "lightmaps/%s", c->ones[k].name);
    const int status = kiln_path_join(a, c->a, name, error);
    return status == KILN_OK ? kiln_path_join(b, c->b, name, error) : status;
}

static int read_pair(const struct comparison *c, size_t k, struct kiln_image **a, struct kiln_image **b, struct kiln_error *error)
{
    char path_a[KILN_PATH_SIZE], path_b[KILN_PATH_SIZE];
    *a = *b = NULL;
    int status = image_paths(c, k, path_a, path_b, error);
    if (status == KILN_OK)
        status = kiln_exr_read(path_a, NULL, 0, a, error);
    if (status == KILN_OK)
        status = kiln_exr_read(path_b, NULL, 0, b, error);
    return status;
}

static int compare_one(struct comparison *c, size_t k, struct kiln_error *error)
{
    struct kiln_image *a, *b;
    struct kiln_error inner = {{0}};
    int status = read_pair(c, k, &a, &b, error);
    if (status == KILN_OK) {
        status = kiln_compare_images(a, b, &c->ones[k].difference, &inner);
        if (status != KILN_OK)
            (void)kiln_fail(error, status, "%s%s%s", c->ones[k].name, c->ones[k].name[0] == '\0' ? "" : ": ", inner.message);
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
    (void)snprintf(c->ones[c->count++].name, sizeof c->ones->name, "%s", name);
    return KILN_OK;
}

static int compare_names(const void *a, const void *b) { return strcmp(((const struct one *)a)->name, ((const struct one *)b)->name); }

/* Names of the lightmaps in a bake's folder, in the order of their bytes. */
static int list_lightmaps(struct comparison *c, const char *directory, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    int status = kiln_path_join(path, directory, "lightmaps", error);
    if (status != KILN_OK)
        return status;
    DIR *folder = opendir(path);
    if (folder == NULL)
        return kiln_fail_errno(error, 0, "'%s' is not the folder of a bake: '%s' cannot be read", directory, path);
    const struct dirent *entry;
    while (status == KILN_OK && (entry = readdir(folder)) != NULL) {
        const size_t length = strlen(entry->d_name);
        if (entry->d_name[0] != '.' && length > 4 && length < sizeof c->ones->name && strcmp(entry->d_name + length - 4, ".exr") == 0)
            status = add_one(c, entry->d_name, error);
    }
    (void)closedir(folder);
    if (status == KILN_OK && c->count > 0)
        qsort(c->ones, c->count, sizeof *c->ones, compare_names);
    return status;
}

/* Both folders must hold the same lightmaps: what is missing on one side is an error, not something to pass over. */
static int list_pairs(struct comparison *c, struct kiln_error *error)
{
    struct comparison other = {0};
    int status = list_lightmaps(c, c->a, error);
    if (status == KILN_OK)
        status = list_lightmaps(&other, c->b, error);
    for (size_t i = 0; status == KILN_OK && (i < c->count || i < other.count); i++) {
        const int order = i >= c->count ? 1 : i >= other.count ? -1 : strcmp(c->ones[i].name, other.ones[i].name);
        if (order != 0)
            status = kiln_fail(error, KILN_BAD_INPUT, "lightmap '%s' is in '%s' but not in '%s': these are not bakes of the same scene",
                               order < 0 ? c->ones[i].name : other.ones[i].name, order < 0 ? c->a : c->b, order < 0 ? c->b : c->a);
    }
    if (status == KILN_OK && c->count == 0)
        status = kiln_fail(error, KILN_BAD_INPUT, "there are no lightmaps in '%s/lightmaps' and '%s/lightmaps'", c->a, c->b);
    kiln_free(&other.ones);
    return status;
}

static int compare_all(struct comparison *c, struct kiln_error *error)
{
    bool folder_a = false, folder_b = false;
    int status = is_folder(c->a, &folder_a, error);
    if (status == KILN_OK)
        status = is_folder(c->b, &folder_b, error);
    if (status == KILN_OK && folder_a != folder_b)
        status = kiln_fail(error, KILN_USAGE, "'%s' is a folder and '%s' is not: compare two bakes or two EXR files", folder_a ? c->a : c->b,
                           folder_a ? c->b : c->a);
    if (status == KILN_OK)
        status = folder_a ? list_pairs(c, error) : add_one(c, "", error);
    c->total = (struct kiln_difference){.identical = true};
    for (size_t k = 0; status == KILN_OK && k < c->count; k++) {
        status = compare_one(c, k, error);
        if (status != KILN_OK)
            break;
        if (c->ones[k].difference.worst > c->ones[c->worst].difference.worst)
            c->worst = k;
        kiln_difference_add(&c->total, &c->ones[k].difference);
    }
    return status;
}

/* ---- telling ---- */

static json_t *number_json(double value) { return isfinite(value) ? json_real(value) : json_null(); }

static json_t *difference_json(const struct kiln_difference *d)
{
    json_t *channels = json_object();
    for (uint32_t c = 0; c < d->channel_count; c++)
        json_object_set_new(channels, d->channels[c].name,
                            json_pack("{s:f, s:f, s:f}", "rmse", d->channels[c].rmse, "mean_difference", d->channels[c].mean_difference, "mean",
                                      d->channels[c].mean));
    return json_pack("{s:b, s:I, s:I, s:I, s:f, s:f, s:o, s:f, s:o, s:f, s:f, s:f, s:{s:f, s:i, s:i}, s:o}", "identical", d->identical, "texels",
                     (json_int_t)d->texels, "interior_texels", (json_int_t)d->interior, "not_finite", (json_int_t)d->not_finite, "mean", d->mean,
                     "rmse", d->rmse, "nrmse", number_json(d->nrmse), "rel_rmse", d->rel_rmse, "psnr", number_json(d->psnr), "dssim", d->dssim, "dfpr",
                     d->dfpr, "dfpr_unit", d->dfpr_unit, "worst", "difference", d->worst, "x", (int)d->worst_x, "y", (int)d->worst_y, "channels",
                     channels);
}

static int print_json(const struct comparison *c, struct kiln_error *error)
{
    json_t *root = difference_json(&c->total);
    if (root != NULL) {
        json_object_set_new(root, "status", json_string("done"));
        json_object_set_new(root, "a", json_string(c->a));
        json_object_set_new(root, "b", json_string(c->b));
    }
    json_t *objects = json_object();
    for (size_t k = 0; k < c->count && c->ones[k].name[0] != '\0'; k++)
        json_object_set_new(objects, c->ones[k].name, difference_json(&c->ones[k].difference));
    if (json_object_size(objects) > 0) {
        json_object_set_new(json_object_get(root, "worst"), "lightmap", json_string(c->ones[c->worst].name));
        json_object_set(root, "lightmaps", objects);
    }
    json_decref(objects);
    return kiln_json_print(root, error);
}

static void print_text(const struct comparison *c)
{
    const struct kiln_difference *d = &c->total;
    (void)printf("%s\n", d->identical ? "bit-identical" : "different");
    (void)printf("texels     %llu valid in both, %llu of them wholly inside charts\n", (unsigned long long)d->texels, (unsigned long long)d->interior);
    if (d->not_finite > 0)
        (void)printf("left out   %llu texels that are not finite numbers\n", (unsigned long long)d->not_finite);
    (void)printf("mean       %.6g W/m2 (reference)\n", d->mean);
    (void)printf("rmse       %.6g W/m2\n", d->rmse);
    if (isfinite(d->nrmse))
        (void)printf("nrmse      %.4f %% of the mean, wholly inside charts\n", 100.0 * d->nrmse);
    else
        (void)puts("nrmse      - (no lit texel wholly inside charts)");
    (void)printf("rel-rmse   %.4f %%\n", 100.0 * d->rel_rmse);
    (void)printf("psnr       %.2f dB\n", d->psnr);
    (void)printf("dssim      %.6g\n", d->dssim);
    (void)printf("dfpr       %.6g W/m2; %.6g with the brightest value as 1\n", d->dfpr, d->dfpr_unit);
    (void)printf("worst      %.6g W/m2 at texel (%u, %u)%s%s\n", d->worst, d->worst_x, d->worst_y, c->ones[c->worst].name[0] == '\0' ? "" : " of ",
                 c->ones[c->worst].name);
    for (uint32_t i = 0; i < d->channel_count; i++)
        (void)printf("  %-12s rmse %.6g, mean of the difference %.6g, mean %.6g\n", d->channels[i].name, d->channels[i].rmse,
                     d->channels[i].mean_difference, d->channels[i].mean);
}

/* The image with the worst texel; full scale is 10 % of the reference's mean. */
static int write_picture(const struct comparison *c, const char *path, struct kiln_error *error)
{
    struct kiln_image *a, *b;
    uint8_t *bytes = NULL;
    int status = read_pair(c, c->worst, &a, &b, error);
    if (status == KILN_OK)
        status = kiln_allocate(&bytes, (size_t)a->width * a->height * 3, 1, "a picture", error);
    if (status == KILN_OK)
        status = kiln_difference_picture(a, b, 0.1, bytes, error);
    if (status == KILN_OK)
        status = kiln_png_write_bytes(path, bytes, a->width, a->height, "difference of two lightmaps: black none, white 10 % of the mean and more", error);
    kiln_free(&bytes);
    kiln_image_destroy(&a);
    kiln_image_destroy(&b);
    return status;
}

int kiln_command_compare(struct kiln_job *job, struct kiln_error *error)
{
    struct comparison c = {.a = job->arguments[0], .b = job->arguments[1]};
    int status = compare_all(&c, error);
    if (status == KILN_OK && job->output != NULL)
        status = write_picture(&c, job->output, error);
    if (status == KILN_OK && job->json)
        status = print_json(&c, error);
    else if (status == KILN_OK && !job->quiet)
        print_text(&c);
    kiln_free(&c.ones);
    return status;
}
