/* Run by mpirun on two ranks. Values that are the same pass, and so do collective calls whose arguments agree; where
 * one rank has another value, both learn of it, with a sentence that has both. With a first argument, one call gets
 * what the ranks do not agree on: the checks of debug builds, which this file and the tests' copies of the sources have
 * in every build, end both ranks. The last argument is an empty folder. */
#undef NDEBUG
#include <mpi.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/field/radiosity_allgather.h"
#include "coordinator/field/rank_data.h"
#include "coordinator/mpi/assert_same.h"
#include "coordinator/mpi/redistribute.h"
#include "coordinator/run/checkpoint.h"

enum { TOTAL = 8 };

struct test {
    int rank, failures;
    const char *differ; /* what the ranks do not agree on; NULL: nothing */
    char folder[64];
    struct kiln_node_memory *node;
    struct kiln_error error;
};

static void expect(struct test *t, bool good, const char *what)
{
    if (good)
        return;
    (void)fprintf(stderr, "rank %d: %s (%s)\n", t->rank, what, t->error.message);
    t->failures++;
}

/* Whether this rank is to bring something else. */
static bool differs(const struct test *t, const char *what)
{
    return t->differ != NULL && strcmp(t->differ, what) == 0 && t->rank == 1;
}

/* Whether what this rank and the other bring gives the status, and the sentence both values. */
static bool right(uint64_t own, int wanted, const char *least, const char *most)
{
    struct kiln_error error = {{0}};
    const int status = kiln_same(MPI_COMM_WORLD, own, "the number of goats", &error);
    return status == wanted &&
           (wanted == KILN_OK || (strstr(error.message, "goats") != NULL && strstr(error.message, least) != NULL &&
                                  strstr(error.message, most) != NULL));
}

static void check_values(struct test *t)
{
    const bool second = t->rank == 1;
    expect(t, right(7, KILN_OK, "", "") && right(0, KILN_OK, "", "") && right(UINT64_MAX, KILN_OK, "", ""),
           "the same value on all ranks is refused");
    expect(t, right(second ? 8 : 7, KILN_BUG, "from 7", "to 8"), "7 and 8 are the same");
    expect(t, right(second ? 0 : UINT64_MAX, KILN_BUG, "from 0", "to 18446744073709551615"), "0 and the largest");
    kiln_assert_same(MPI_COMM_WORLD, 3, "three");
    kiln_assert_same_bytes(MPI_COMM_WORLD, "abc", 3, "letters");
    kiln_assert_same_bytes(MPI_COMM_WORLD, NULL, 0, "nothing");
    kiln_assert_same_json(MPI_COMM_WORLD, NULL, "nothing");
    kiln_assert_ranges(MPI_COMM_WORLD, second ? 5 : 0, second ? 3 : 5, 8, "five and three");
}

static void check_redistribute(const struct test *t)
{
    static const uint64_t halves[] = {0, 2, 4}, thirds[] = {0, 1, 4};
    const char from[4] = {0};
    char to[4];
    (void)kiln_redistribute(MPI_COMM_WORLD, halves, differs(t, "moved") ? thirds : halves, 1, 0, from, to, NULL);
}

/* A surface without own points, as arrays that can be freed. */
static void make_surface(struct kiln_surface *surface)
{
    *surface = (struct kiln_surface){.point_count = TOTAL, .global_is_borrowed = true};
    (void)kiln_allocate(&surface->piece_base, 1, sizeof *surface->piece_base, "no pieces", NULL);
    (void)kiln_allocate(&surface->area_cdf_base, 1, sizeof *surface->area_cdf_base, "no pieces", NULL);
}

static void check_node_data(struct test *t)
{
    const struct kiln_job job = {0};
    struct kiln_surface surface;
    struct kiln_node_data *data = NULL;
    struct kiln_field_set fields;
    struct kiln_range_bounds before = {{NULL}}, after = {{NULL}};
    make_surface(&surface);
    kiln_field_set_choose(&fields, &job);
    if (differs(t, "fields")) {
        const struct kiln_field_entry first = fields.entry[0];
        fields.entry[0] = fields.entry[1];
        fields.entry[1] = first;
    }
    int status = kiln_node_data_create(&data, t->node, &surface, &fields, differs(t, "lend"), &t->error);
    if (status == KILN_OK)
        status = kiln_node_data_bounds(data, MPI_COMM_WORLD, &before, &t->error);
    if (status == KILN_OK)
        status = kiln_range_bounds_create(&after, 2, &t->error);
    expect(t, status == KILN_OK, "a rank's data cannot be made");
    if (differs(t, "bounds"))
        after.of[KILN_DOMAIN_PIECE][1] = after.of[KILN_DOMAIN_PIECE][2] = 1;
    status = kiln_node_data_redistribute(data, MPI_COMM_WORLD, &before, &after, differs(t, "limit") ? 5 : 4, &t->error);
    expect(t, status == KILN_OK, "no points cannot be moved");
    kiln_range_bounds_destroy(&before);
    kiln_range_bounds_destroy(&after);
    kiln_node_data_destroy(&data);
}

static void check_allgather(struct test *t)
{
    static const uint32_t next[TOTAL] = {0};
    const uint64_t half = TOTAL / 2;
    const struct kiln_radiosity_allgather_params params = {.communicator = MPI_COMM_WORLD,
                                                           .node = t->node,
                                                           .total = differs(t, "total") ? TOTAL + 1 : TOTAL,
                                                           .first = {t->rank == 0 ? 0 : half},
                                                           .count = differs(t, "ranges") ? half - 1 : half,
                                                           .threads = 1,
                                                           .groups = differs(t, "groups") ? 2 : 1};
    struct kiln_radiosity_allgather *x = NULL;
    const int status = kiln_radiosity_allgather_create(&x, &params, &t->error);
    expect(t, status == KILN_OK, "the exchange cannot be made");
    kiln_radiosity_allgather_set_scale(x, differs(t, "scale") ? 2.0 : 1.0);
    kiln_radiosity_allgather_begin(x);
    kiln_radiosity_allgather_finish(x, next);
    const struct kiln_global_point first = {t->rank == 0 || differs(t, "new_range") ? 0 : half};
    expect(t, kiln_radiosity_allgather_set_range(x, first, half, &t->error) == KILN_OK, "the ranges cannot change");
    if (!differs(t, "abandon"))
        kiln_radiosity_allgather_begin(x);
    kiln_radiosity_allgather_abandon(x);
    kiln_radiosity_allgather_all(x);
    kiln_radiosity_allgather_destroy(&x);
}

static void check_checkpoint(struct test *t)
{
    const uint64_t value = 7;
    const struct kiln_array_range block = {"sevens", (uint64_t)t->rank, 1, sizeof value, &value};
    json_t *identity = json_pack("{s:i}", "seed", differs(t, "identity") ? 2 : 1);
    struct kiln_checkpoint *checkpoint = NULL;
    int status = kiln_checkpoint_open(&checkpoint, MPI_COMM_WORLD, differs(t, "folder") ? "/" : t->folder,
                                      differs(t, "take"), &t->error);
    if (status == KILN_OK)
        status = kiln_checkpoint_write(checkpoint, identity, &block, 1, &t->error);
    expect(t, status == KILN_OK, "a checkpoint cannot be written");
    kiln_checkpoint_remove(checkpoint);
    kiln_checkpoint_close(&checkpoint);
    json_decref(identity);
}

int main(int argc, char **argv)
{
    struct test t = {.differ = argc > 2 ? argv[1] : NULL};
    int total = 0;
    MPI_Init(&argc, &argv);
    MPI_Comm_rank(MPI_COMM_WORLD, &t.rank);
    (void)snprintf(t.folder, sizeof t.folder, "%s", argv[argc - 1]);
    check_values(&t);
    check_redistribute(&t);
    int status = kiln_node_create(&t.node, MPI_COMM_WORLD, 1, &t.error);
    expect(&t, status == KILN_OK, "node memory cannot be made");
    check_allgather(&t);
    kiln_node_destroy(&t.node);
    status = kiln_node_create(&t.node, MPI_COMM_WORLD, 0, &t.error);
    expect(&t, status == KILN_OK, "node memory cannot be made");
    check_node_data(&t);
    kiln_node_destroy(&t.node);
    check_checkpoint(&t);
    if (t.differ != NULL)
        (void)fprintf(stderr, "rank %d: nobody noticed\n", t.rank);
    MPI_Allreduce(&t.failures, &total, 1, MPI_INT, MPI_SUM, MPI_COMM_WORLD);
    MPI_Finalize();
    return total != 0;
}
