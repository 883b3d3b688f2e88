/* Run by mpirun on three ranks: a field that nobody has heard of, one row and an array, goes wherever fields go. Its
 * values move to other ranks with the points, are in checkpoints and come back from them on other ranges, are refused
 * where no bake can have them, and stand in kiln.h5 and the lightmaps as they were computed. */
#include <ftw.h>
#include <hdf5.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/files/foreign_json.h"
#include "coordinator/field/field_blocks.h"
#include "coordinator/output/exr.h"
#include "coordinator/output/map/write/lightmaps.h"
#include "tests/common/synthetic.h"

static const char *const channels[] = {"made_up.X", "made_up.Y", "made_up.Z"};
static const struct kiln_field made_up = {.name = "made_up",
                                          .unit = "1",
                                          .type = KILN_FIELD_FLOAT,
                                          .components = 3,
                                          .domain = KILN_DOMAIN_POINT,
                                          .life = KILN_FIELD_RESULT,
                                          .saved = KILN_FIELD_SAVED,
                                          .low = -1.0,
                                          .high = 1.0,
                                          .dataset = "/points/made_up",
                                          .description = "a field of this test alone",
                                          .channels = channels,
                                          .attribute = "kiln:madeUp"};

/* Returns the value of component c at a point. */
static float wanted_at(uint64_t point, uint64_t c) { return sinf(0.37f * (float)(3 * point + c)); }

struct test {
    int rank, ranks, failures;
    struct synthetic scene;
    struct kiln_surface surface;
    struct kiln_node_memory *node;
    struct kiln_node_data *data;
    struct kiln_field_set fields;
    size_t made_up; /* its place there */
    char directory[64];
    struct kiln_error error;
};

static void expect(struct test *t, bool good, const char *what)
{
    if (good)
        return;
    (void)fprintf(stderr, "rank %d: %s (%s)\n", t->rank, what, t->error.message);
    t->failures++;
}

/* ---- a rank's data ---- */

static void *copy(const void *from, size_t count, size_t size)
{
    void *to = NULL;
    if (kiln_allocate(&to, count, size, "a copy", NULL) != KILN_OK)
        MPI_Abort(MPI_COMM_WORLD, 1);
    memcpy(to, from, count * size);
    return to;
}

static uint64_t *copy_bases(const uint64_t *from, size_t count)
{
    uint64_t *to = copy(from, count, sizeof *from);
    for (size_t i = count; i-- > 0;)
        to[i] -= to[0];
    return to;
}

/* The synthetic scene's own part in arrays that can be freed one by one. */
static void copy_surface(struct test *t)
{
    const struct kiln_surface *s = &t->scene.surface;
    const size_t runs = s->tile_run_count, pieces = s->piece_base[runs] - s->piece_base[0],
                 shares = s->area_cdf_base[runs] - s->area_cdf_base[0];
    t->surface = *s;
    t->surface.global_is_borrowed = true;
    t->surface.tile_runs = copy(s->tile_runs, runs, sizeof *s->tile_runs);
    t->surface.pieces = copy(s->pieces + s->piece_base[0], pieces, sizeof *s->pieces);
    t->surface.area_cdf = copy(s->area_cdf + s->area_cdf_base[0], shares, sizeof *s->area_cdf);
    t->surface.piece_base = copy_bases(s->piece_base, runs + 1);
    t->surface.area_cdf_base = copy_bases(s->area_cdf_base, runs + 1);
    t->surface.piece_count = copy(s->piece_count, s->count, sizeof *s->piece_count);
    t->surface.albedo = copy(s->albedo, s->count, 3 * sizeof *s->albedo);
    t->surface.area = copy(s->area, s->count, sizeof *s->area);
    t->surface.visible = copy(s->visible, s->count, sizeof *s->visible);
}

static const struct kiln_rank_data *own(const struct test *t)
{
    return kiln_rank_data(t->data, kiln_node_data_own(t->data));
}

static float *values(const struct test *t) { return kiln_rank_field(own(t), &t->fields, t->made_up); }

static void fill(struct test *t)
{
    const struct kiln_rank_data *data = own(t);
    for (uint64_t i = 0; i < data->surface.count; i++)
        for (uint64_t c = 0; c < 3; c++)
            values(t)[3 * i + c] = wanted_at(data->surface.first.at + i, c);
    memcpy(data->direct, t->scene.direct, data->surface.count * 3 * sizeof(float));
    memcpy(data->sum, t->scene.indirect, data->surface.count * 3 * sizeof(float));
    memcpy(data->error, t->scene.error, data->surface.count * sizeof(uint16_t));
    for (uint64_t i = 0; i < data->surface.count; i++)
        if (data->surface.visible[i] == 0) /* where the synthetic scene has no number */
            data->direct[3 * i] = 0.0f;
}

static bool has_all(const struct test *t)
{
    bool good = true;
    for (uint64_t i = 0; i < own(t)->surface.count; i++)
        for (uint64_t c = 0; c < 3; c++)
            good = good && values(t)[3 * i + c] == wanted_at(own(t)->surface.first.at + i, c);
    return good;
}

static void make(struct test *t, bool lend)
{
    int status = synthetic_create(&t->scene, 75, 64, t->rank, t->ranks, &t->error);
    t->fields = t->scene.fields;
    t->made_up = t->fields.count;
    if (status == KILN_OK)
        status = kiln_field_set_add(&t->fields, &made_up, true, &t->error);
    if (status == KILN_OK)
        status = kiln_node_create(&t->node, MPI_COMM_WORLD, 0, &t->error);
    copy_surface(t);
    if (status == KILN_OK)
        status = kiln_node_data_create(&t->data, t->node, &t->surface, &t->fields, lend, &t->error);
    if (status != KILN_OK) {
        (void)fprintf(stderr, "rank %d: %s\n", t->rank, t->error.message);
        MPI_Abort(MPI_COMM_WORLD, 1);
    }
    for (uint64_t i = 0; i < 3 * own(t)->surface.count; i++)
        expect(t, values(t)[i] == 0.0f, "a result does not begin with zero");
    fill(t);
}

static void drop(struct test *t)
{
    kiln_node_data_destroy(&t->data);
    kiln_node_destroy(&t->node);
    kiln_geometry_destroy(&t->scene.geometry);
}

/* ---- redistribution ---- */

/* Each rank but the first begins where a part of its own tile runs, `share` of them, is over. */
static void make_bounds(const struct test *t, double share, const struct kiln_range_bounds *before,
                        struct kiln_range_bounds *after)
{
    const struct kiln_surface *s = &own(t)->surface;
    const int r = t->rank;
    const size_t f = (size_t)(share * (double)s->tile_run_count);
    (void)kiln_range_bounds_create(after, t->ranks, NULL);
    if (r > 0) {
        after->of[KILN_DOMAIN_TILE_RUN][r] = before->of[KILN_DOMAIN_TILE_RUN][r] + f;
        after->of[KILN_DOMAIN_POINT][r] = f < s->tile_run_count ? s->tile_runs[f].first.at : s->first.at + s->count;
        after->of[KILN_DOMAIN_PIECE][r] = before->of[KILN_DOMAIN_PIECE][r] + s->piece_base[f];
        after->of[KILN_DOMAIN_AREA_CDF][r] = before->of[KILN_DOMAIN_AREA_CDF][r] + s->area_cdf_base[f];
    }
    for (int d = 0; d < KILN_DOMAINS; d++) {
        after->of[d][t->ranks] = before->of[d][t->ranks];
        (void)MPI_Allreduce(MPI_IN_PLACE, after->of[d], t->ranks + 1, MPI_UINT64_T, MPI_MAX, MPI_COMM_WORLD);
    }
}

static void redistribute(struct test *t, double share)
{
    struct kiln_range_bounds before, after = {{NULL}};
    const uint64_t first = own(t)->surface.first.at;
    int status = kiln_node_data_bounds(t->data, MPI_COMM_WORLD, &before, &t->error);
    make_bounds(t, share, &before, &after);
    if (status == KILN_OK)
        status = kiln_node_data_redistribute(t->data, MPI_COMM_WORLD, &before, &after, 1000, &t->error);
    expect(t, status == KILN_OK, "points cannot be moved");
    expect(t, t->rank == 0 || own(t)->surface.first.at != first, "nothing was moved");
    expect(t, has_all(t), "values did not move with the points");
    kiln_range_bounds_destroy(&before);
    kiln_range_bounds_destroy(&after);
}

/* Who steals work sees the owner's values. */
static void look_at_others(struct test *t)
{
    kiln_node_wait(t->node);
    for (int i = 0; i < kiln_node_data_count(t->data); i++) {
        const struct kiln_rank_data *data = kiln_rank_data(t->data, i);
        const float *theirs = kiln_rank_field(data, &t->fields, t->made_up);
        expect(t, data->surface.count == 0 || theirs[0] == wanted_at(data->surface.first.at, 0),
               "another rank's values are not seen");
    }
    kiln_node_wait(t->node);
}

/* ---- checkpoints ---- */

static int save(struct test *t)
{
    static const struct kiln_save_moment after_all = {.in_step = false};
    struct kiln_checkpoint *checkpoint = NULL;
    struct kiln_array_range blocks[KILN_FIELDS_MAX];
    json_t *identity = json_object();
    const size_t count = kiln_field_arrays(&t->fields, own(t), &after_all, blocks);
    int status = kiln_checkpoint_open(&checkpoint, MPI_COMM_WORLD, t->directory, false, &t->error);
    if (status == KILN_OK)
        status = kiln_checkpoint_write(checkpoint, identity, blocks, count, &t->error);
    kiln_checkpoint_close(&checkpoint);
    json_decref(identity);
    return status;
}

static int restore(struct test *t, const struct kiln_field_set *fields, bool *changed)
{
    static const struct kiln_save_moment after_all = {.in_step = false};
    struct kiln_checkpoint *checkpoint = NULL;
    int status = kiln_checkpoint_open(&checkpoint, MPI_COMM_WORLD, t->directory, true, &t->error);
    if (status == KILN_OK)
        status = kiln_field_arrays_read(checkpoint, fields, own(t), &after_all, changed, &t->error);
    kiln_checkpoint_close(&checkpoint);
    return status;
}

static void save_and_restore(struct test *t)
{
    bool changed = true;
    expect(t, save(t) == KILN_OK, "a checkpoint cannot be written");
    redistribute(t, 0.3);
    memset(values(t), 0, own(t)->surface.count * 3 * sizeof(float));
    memset(own(t)->direct, 0, own(t)->surface.count * 3 * sizeof(float));
    expect(t, restore(t, &t->fields, &changed) == KILN_OK, "a checkpoint cannot be read");
    expect(t, has_all(t), "values did not come back from the checkpoint");
    expect(t, !changed, "the surface has changed");
    expect(t, own(t)->surface.count < 2 || own(t)->direct[3] != 0.0f, "other fields did not come back");
    own(t)->surface.visible[0] ^= 1;
    expect(t, restore(t, &t->fields, &changed) == KILN_OK && changed, "a changed surface is not noticed");
    expect(t, restore(t, &t->scene.fields, &changed) == KILN_OK, "a bake without the field cannot read it");
}

static void save_lies(struct test *t)
{
    bool changed;
    float *lie = &values(t)[3 * (own(t)->surface.count - 1)];
    const float truth = *lie;
    const float lies[] = {1.5f, -1.5f, NAN, INFINITY};
    for (size_t i = 0; i < sizeof lies / sizeof *lies; i++) {
        *lie = lies[i];
        expect(t, save(t) == KILN_OK, "a checkpoint cannot be written");
        expect(t, restore(t, &t->fields, &changed) == KILN_IO && strstr(t->error.message, "'made_up'") != NULL,
               "values that no bake can have are taken");
        t->error.message[0] = '\0';
    }
    *lie = truth;
}

/* ---- files ---- */

static bool is_valid(uint64_t point) { return point % 37 != 5; }

/* Rank 0. */
static void read_h5(struct test *t, const char *path, bool is_there)
{
    const uint64_t points = t->surface.point_count;
    (void)H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    const hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT),
                dataset = H5Dopen2(file, made_up.dataset, H5P_DEFAULT);
    expect(t, (dataset >= 0) == is_there, "kiln.h5 has the dataset, or has it not");
    if (dataset < 0) {
        (void)H5Fclose(file);
        return;
    }
    float *found = NULL;
    (void)kiln_allocate(&found, points, 3 * sizeof *found, "values", NULL);
    expect(t, H5Dread(dataset, H5T_NATIVE_FLOAT, H5S_ALL, H5S_ALL, H5P_DEFAULT, found) >= 0, "it cannot be read");
    for (uint64_t i = 0; i < points; i++)
        for (uint64_t c = 0; c < 3; c++)
            expect(t, found[3 * i + c] == (is_valid(i) ? wanted_at(i, c) : 0.0f), "kiln.h5 has another value");
    kiln_free(&found);
    (void)H5Dclose(dataset);
    (void)H5Fclose(file);
}

/* Rank 0. */
static void read_lightmap(struct test *t, const char *path, bool is_there)
{
    struct kiln_image *image = NULL;
    const struct kiln_lightmap *map = &t->surface.lightmaps[0];
    if (kiln_exr_read(path, NULL, 0, &image, &t->error) != KILN_OK) {
        expect(t, false, "a lightmap cannot be read");
        return;
    }
    for (uint32_t c = 0; c < 3; c++) {
        const struct kiln_image_channel *channel = kiln_image_find(image, channels[c]);
        expect(t, (channel != NULL) == is_there, "a lightmap has the channel, or has it not");
        for (uint32_t i = 0; channel != NULL && i < map->width * map->height; i++) {
            const uint64_t point = kiln_surface_find(&t->surface, 0, i % map->width, i / map->width).at;
            expect(t, point == KILN_NO_POINT || !is_valid(point) || channel->values[i] == wanted_at(point, c),
                   "a lightmap has another value");
            expect(t, fabsf(channel->values[i]) <= 1.0f, "a lightmap is filled with what the field cannot be");
        }
    }
    kiln_image_destroy(&image);
}

static void write_files(struct test *t, const struct kiln_field_set *fields, bool is_there)
{
    struct kiln_bake_result result = synthetic_result(&t->scene, MPI_COMM_WORLD);
    result.surface = &t->surface;
    result.fields = fields;
    result.data = own(t);
    const struct kiln_output_params params = {.directory = t->directory, .stitch = true};
    expect(t, kiln_write_lightmaps(&result, &params, NULL, NULL, &t->error) == KILN_OK, "lightmaps cannot be written");
    expect(t, kiln_write_h5(&result, &params, &t->error) == KILN_OK, "kiln.h5 cannot be written");
    if (t->rank != 0)
        return;
    char path[128];
    (void)snprintf(path, sizeof path, "%s/kiln.h5", t->directory);
    read_h5(t, path, is_there);
    (void)snprintf(path, sizeof path, "%s/lightmaps/first.exr", t->directory);
    read_lightmap(t, path, is_there);
}

/* ---- */

static void try_all(struct test *t, bool lend)
{
    make(t, lend);
    redistribute(t, 0.6);
    look_at_others(t);
    save_and_restore(t);
    save_lies(t);
    write_files(t, &t->scene.fields, false); /* a bake that does not have the field */
    write_files(t, &t->fields, true);
    expect(t,
           kiln_field_set_saved_bytes(&t->fields) == kiln_field_set_saved_bytes(&t->scene.fields) + 12 &&
               kiln_field_set_light_bytes(&t->fields, 10, 20) ==
                   kiln_field_set_light_bytes(&t->scene.fields, 10, 20) + 120,
           "what is predicted does not count the field");
    drop(t);
}

static int remove_one(const char *path, const struct stat *found, int kind, struct FTW *where)
{
    (void)found;
    (void)kind;
    (void)where;
    return remove(path);
}

int main(int argc, char **argv)
{
    if (argc > 1 && strcmp(argv[1], KILN_JSON_CHILD) == 0) /* which reads manifests of checkpoints */
        return kiln_foreign_json_child(argc, argv, NULL);
    static struct test t = {.directory = "/tmp/kiln-fields-XXXXXX"};
    int total = 0;
    MPI_Init(&argc, &argv);
    MPI_Comm_rank(MPI_COMM_WORLD, &t.rank);
    MPI_Comm_size(MPI_COMM_WORLD, &t.ranks);
    if (t.ranks != 3 || (t.rank == 0 && mkdtemp(t.directory) == NULL)) {
        (void)fprintf(stderr, "this test wants three ranks, not %d, and a folder in /tmp\n", t.ranks);
        MPI_Abort(MPI_COMM_WORLD, 1);
    }
    MPI_Bcast(t.directory, sizeof t.directory, MPI_CHAR, 0, MPI_COMM_WORLD);
    try_all(&t, false);
    try_all(&t, true);
    MPI_Barrier(MPI_COMM_WORLD);
    if (t.rank == 0)
        (void)nftw(t.directory, remove_one, 16, FTW_DEPTH | FTW_PHYS);
    MPI_Allreduce(&t.failures, &total, 1, MPI_INT, MPI_SUM, MPI_COMM_WORLD);
    MPI_Finalize();
    return total != 0;
}
