#include "coordinator/field/rank_data.h"

#include <string.h>

#include "coordinator/mpi/redistribute.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/assert_same.h"
#include "worker/base/memory.h"

/* Kinds of life of fields that have memory of their own, and their names in messages. */
enum { LIVES = KILN_FIELD_STEP + 1 };
static const char *const purposes[LIVES] = {[KILN_FIELD_SURFACE] = "the surface points",
                                            [KILN_FIELD_RESULT] = "irradiance",
                                            [KILN_FIELD_STEP] = "the radiosity of a bounce"};

/* Range of one rank, as the ranks of a node exchange it. */
struct extent {
    struct kiln_global_point first;
    uint64_t count[KILN_DOMAINS];
};

struct kiln_node_data {
    struct kiln_node_memory *node; /* NULL: nothing is lent */
    struct kiln_surface *surface;
    int count, own;
    struct kiln_field_set fields;
    uint64_t *radiosity;                    /* of all points, borrowed; NULL: not known yet */
    struct kiln_rank_regions *parts[LIVES]; /* memory by life; NULL for the surface: it is still where it was built */
    struct kiln_rank_data *data;            /* count */
    struct extent *extents;                 /* count */
};

/* Offset of the pointer to a field's array in struct kiln_rank_data. */
static size_t pointer_offset(const struct kiln_field_set *fields, size_t index)
{
    const size_t member = fields->entry[index].field->member;
    return member != 0 ? member : offsetof(struct kiln_rank_data, more) + index * sizeof(void *);
}

void *kiln_rank_field(const struct kiln_rank_data *data, const struct kiln_field_set *fields, size_t index)
{
    void *pointer;
    memcpy(&pointer, (const char *)data + pointer_offset(fields, index), sizeof pointer);
    return pointer;
}

static void set_pointer(struct kiln_rank_data *data, const struct kiln_field_set *fields, size_t index, void *pointer)
{
    memcpy((char *)data + pointer_offset(fields, index), &pointer, sizeof pointer);
}

int kiln_rank_data_add(struct kiln_rank_data *data, const struct kiln_field_set *fields, size_t index,
                       struct kiln_error *error)
{
    const struct kiln_field *field = fields->entry[index].field;
    const uint64_t count = field->domain == KILN_DOMAIN_TILE_RUN ? data->surface.tile_run_count : data->surface.count;
    void *array = NULL;
    const int status = kiln_allocate(&array, (size_t)count, kiln_field_size(field), field->name, error);
    set_pointer(data, fields, index, array);
    return status;
}

void kiln_rank_data_remove(struct kiln_rank_data *data, const struct kiln_field_set *fields, size_t index)
{
    void *array = kiln_rank_field(data, fields, index);
    kiln_free(&array);
    set_pointer(data, fields, index, NULL);
}

void kiln_rank_float_run(const struct kiln_rank_data *data, const struct kiln_field_set *fields, size_t index,
                         struct kiln_own_point first, uint32_t points, float *floats)
{
    const struct kiln_field_entry *entry = &fields->entry[index];
    if (entry->field->life != KILN_FIELD_SUM) {
        kiln_field_floats(entry->field, kiln_rank_field(data, fields, index), first.at, points, floats);
        return;
    }
    float next[KILN_TILE_TEXELS * KILN_FIELD_COMPONENTS_MAX];
    kiln_rank_float_run(data, fields, entry->terms[0], first, points, floats);
    for (size_t k = 1; k < entry->term_count; k++) {
        kiln_rank_float_run(data, fields, entry->terms[k], first, points, next);
        for (uint32_t i = 0; i < points * entry->field->components; i++)
            floats[i] += next[i];
    }
}

void kiln_rank_floats(const struct kiln_rank_data *data, const struct kiln_field_set *fields, size_t index,
                      struct kiln_own_point own, float floats[KILN_FIELD_COMPONENTS_MAX])
{
    kiln_rank_float_run(data, fields, index, own, 1, floats);
}

/* Points a rank's arrays of one life into its part of the memory, which begins at `base` (NULL: only measures). Returns
 * the size of the part, bytes. */
static size_t lay_out(struct kiln_rank_data *data, const struct kiln_field_set *fields, const struct extent *extent,
                      enum kiln_field_life life, char *base)
{
    size_t at = 0;
    for (size_t i = 0; i < fields->count; i++) {
        const struct kiln_field *field = fields->entry[i].field;
        if (field->life != life)
            continue;
        if (base != NULL)
            set_pointer(data, fields, i, base + at);
        at += ((size_t)kiln_field_count(field, extent->count) * kiln_field_size(field) + 63) / 64 * 64;
    }
    return at;
}

/* ---- making ---- */

/* Collective on the node. Makes a part for each of the node's ranks, and points the arrays of one life there. */
static int make_parts(struct kiln_node_data *d, enum kiln_field_life life, struct kiln_error *error)
{
    const size_t bytes = lay_out(NULL, &d->fields, &d->extents[d->own], life, NULL);
    const int status = kiln_rank_regions_create(&d->parts[life], d->node, bytes, purposes[life], error);
    for (int i = 0; i < d->count && status == KILN_OK; i++)
        (void)lay_out(&d->data[i], &d->fields, &d->extents[i], life, kiln_rank_region(d->parts[life], i));
    return status;
}

static void keep_to_oneself(struct kiln_node_data *d)
{
    d->extents[0] = d->extents[d->own];
    d->data[0] = d->data[d->own];
    d->node = NULL;
    d->count = 1;
    d->own = 0;
}

/* Collective on the node. Does as make_parts, or uses each rank's own memory if there is no room in the node's. */
static int make_somewhere(struct kiln_node_data *d, enum kiln_field_life life, struct kiln_error *error)
{
    if (d->node != NULL && make_parts(d, life, NULL) == KILN_OK)
        return KILN_OK;
    keep_to_oneself(d);
    return make_parts(d, life, error);
}

static void point_to_radiosity(struct kiln_node_data *d)
{
    for (int i = 0; i < d->count; i++)
        d->data[i].source = d->radiosity != NULL ? d->radiosity + d->extents[i].first.at : NULL;
}

void kiln_node_data_set_radiosity(struct kiln_node_data *d, uint64_t *radiosity)
{
    d->radiosity = radiosity;
    point_to_radiosity(d);
}

/* Collective on the node. All its ranks' extents, and views of the right lengths. */
static void learn_extents(struct kiln_node_data *d, const struct extent *own)
{
    if (d->node == NULL)
        d->extents[0] = *own;
    else
        (void)MPI_Allgather(own, sizeof *own, MPI_BYTE, d->extents, sizeof *own, MPI_BYTE,
                            kiln_node_communicator(d->node));
    for (int i = 0; i < d->count; i++) {
        struct kiln_surface *view = &d->data[i].surface;
        *view = *d->surface;
        view->first = d->extents[i].first;
        view->count = d->extents[i].count[KILN_DOMAIN_POINT];
        view->tile_run_count = (size_t)d->extents[i].count[KILN_DOMAIN_TILE_RUN];
    }
    point_to_radiosity(d);
}

static bool is_of_surface(const struct kiln_node_data *d, size_t index)
{
    return d->fields.entry[index].field->life == KILN_FIELD_SURFACE;
}

/* Frees a surface that was not in parts before. */
static void free_surface(const struct kiln_node_data *d, struct kiln_rank_data *data)
{
    for (size_t i = 0; i < d->fields.count; i++)
        if (is_of_surface(d, i)) {
            void *old = kiln_rank_field(data, &d->fields, i);
            kiln_free(&old);
        }
}

/* The surface's arrays are now where this rank's data has them. */
static void take_over_surface(struct kiln_node_data *d)
{
    *d->surface = d->data[d->own].surface;
    d->surface->own_is_borrowed = true;
}

/* Collective on the node. Moves the surface to memory of the node. Arrays move one after the other, so that few exist
 * twice. */
static void lend_surface(struct kiln_node_data *d)
{
    struct kiln_rank_data before = {.surface = *d->surface};
    if (d->node == NULL || make_parts(d, KILN_FIELD_SURFACE, NULL) != KILN_OK) {
        keep_to_oneself(d);
        return;
    }
    for (size_t i = 0; i < d->fields.count; i++) {
        const struct kiln_field *field = d->fields.entry[i].field;
        if (!is_of_surface(d, i))
            continue;
        void *old = kiln_rank_field(&before, &d->fields, i);
        memcpy(kiln_rank_field(&d->data[d->own], &d->fields, i), old,
               (size_t)kiln_field_count(field, d->extents[d->own].count) * kiln_field_size(field));
        kiln_free(&old);
    }
    take_over_surface(d);
}

/* Collective on the node. */
static int make_results(struct kiln_node_data *d, struct kiln_error *error)
{
    const int status = make_somewhere(d, KILN_FIELD_RESULT, error);
    return status == KILN_OK ? make_somewhere(d, KILN_FIELD_STEP, error) : status;
}

/* Collective, in debug builds. */
static void assert_same_fields(MPI_Comm communicator, const struct kiln_field_set *fields)
{
    (void)communicator;
    kiln_assert_same(communicator, fields->count, "the number of fields");
    for (size_t i = 0; i < fields->count; i++) {
        kiln_assert_same_text(communicator, fields->entry[i].field->name, "the names of the fields");
        kiln_assert_same(communicator, kiln_field_size(fields->entry[i].field), "the size of a field's values");
    }
}

int kiln_node_data_create(struct kiln_node_data **node_data, struct kiln_node_memory *node,
                          struct kiln_surface *surface, const struct kiln_field_set *fields, bool lend,
                          struct kiln_error *error)
{
    const int ranks = kiln_node_ranks(node);
    struct kiln_node_data *d = NULL;
    assert_same_fields(kiln_node_communicator(node), fields);
    kiln_assert_same(kiln_node_communicator(node), lend, "whether ranks lend their data");
    kiln_assert_same(kiln_node_communicator(node), surface->point_count, "the number of surface points");
    *node_data = NULL;
    int status;
    KILN_TRY(kiln_allocate(&d, 1, sizeof *d, "the data of a node's ranks", error));
    KILN_TRY(kiln_allocate(&d->data, (size_t)ranks, sizeof *d->data, "the data of a node's ranks", error));
    KILN_TRY(kiln_allocate(&d->extents, (size_t)ranks, sizeof *d->extents, "the data of a node's ranks", error));
    if (surface->tile_run_count >= UINT32_MAX)
        KILN_TRY(kiln_fail(error, KILN_SYSTEM, "%zu pieces of lightmap tiles are too many for one rank: use more ranks",
                           surface->tile_run_count));
end:
    status = kiln_agree(kiln_node_communicator(node), status, error);
    if (status == KILN_OK) {
        const struct extent own = {surface->first,
                                   {surface->tile_run_count, surface->count,
                                    surface->piece_base[surface->tile_run_count],
                                    surface->area_cdf_base[surface->tile_run_count]}};
        d->surface = surface;
        d->fields = *fields;
        d->count = 1;
        if (lend && ranks > 1) {
            d->node = node;
            d->count = ranks;
            d->own = kiln_node_rank(node);
        }
        learn_extents(d, &own);
        lend_surface(d);
        status = kiln_agree(kiln_node_communicator(node), make_results(d, error), error);
    }
    *node_data = d;
    if (status != KILN_OK)
        kiln_node_data_destroy(node_data);
    return status;
}

void kiln_rank_data_lend(const struct kiln_rank_data *own, struct kiln_surface *surface)
{
    surface->guide = own->surface.guide;
    surface->closing = own->surface.closing;
}

void kiln_node_data_end(struct kiln_node_data *d) { kiln_rank_regions_destroy(&d->parts[KILN_FIELD_STEP]); }

void kiln_node_data_destroy(struct kiln_node_data **node_data)
{
    struct kiln_node_data *d = *node_data;
    if (d == NULL)
        return;
    for (int life = LIVES - 1; life >= 0; life--)
        kiln_rank_regions_destroy(&d->parts[life]);
    kiln_free(&d->data);
    kiln_free(&d->extents);
    kiln_free(node_data);
}

/* ---- redistribution ---- */

int kiln_range_bounds_create(struct kiln_range_bounds *bounds, int ranks, struct kiln_error *error)
{
    int status = KILN_OK;
    for (int u = 0; u < KILN_DOMAINS && status == KILN_OK; u++)
        status =
            kiln_allocate(&bounds->of[u], (size_t)ranks + 1, sizeof *bounds->of[u], "the ranges of all ranks", error);
    return status;
}

void kiln_range_bounds_destroy(struct kiln_range_bounds *bounds)
{
    for (int u = 0; u < KILN_DOMAINS; u++)
        kiln_free(&bounds->of[u]);
}

int kiln_node_data_bounds(const struct kiln_node_data *d, MPI_Comm communicator, struct kiln_range_bounds *bounds,
                          struct kiln_error *error)
{
    int ranks;
    (void)MPI_Comm_size(communicator, &ranks);
    *bounds = (struct kiln_range_bounds){{NULL}};
    const int status = kiln_agree(communicator, kiln_range_bounds_create(bounds, ranks, error), error);
    for (int u = 0; u < KILN_DOMAINS && status == KILN_OK; u++) {
        uint64_t *of = bounds->of[u];
        (void)MPI_Allgather(&d->extents[d->own].count[u], 1, MPI_UINT64_T, of + 1, 1, MPI_UINT64_T, communicator);
        for (int r = 0; r < ranks; r++)
            of[r + 1] += of[r];
    }
    return status;
}

/* Computes the offsets of each tile run's pieces and area shares from the counts of its points. */
static void find_bases(const struct kiln_surface *s)
{
    s->piece_base[0] = s->area_cdf_base[0] = 0;
    for (size_t f = 0; f < s->tile_run_count; f++) {
        uint64_t pieces = 0;
        struct kiln_own_point own = kiln_own_of_global(s, s->tile_runs[f].first);
        for (uint32_t i = 0; i < s->tile_runs[f].count; i++, own.at++)
            pieces += kiln_piece_count(s, own);
        s->piece_base[f + 1] = s->piece_base[f] + pieces;
        s->area_cdf_base[f + 1] = s->area_cdf_base[f] + pieces - s->tile_runs[f].count;
    }
}

/* Input of a redistribution. */
struct redistribution {
    MPI_Comm communicator;
    const struct kiln_range_bounds *before, *after;
    uint64_t limit;
};

/* Collective. Allocates the arrays of one life anew, and fills them. `old`: this rank's data before. */
static int redistribute_life(struct kiln_node_data *d, const struct redistribution *r, enum kiln_field_life life,
                             const struct kiln_rank_data *old, struct kiln_error *error)
{
    struct kiln_rank_regions *parts = d->parts[life];
    d->parts[life] = NULL;
    int status = kiln_agree(r->communicator, make_somewhere(d, life, error), error);
    for (size_t i = 0; i < d->fields.count && status == KILN_OK; i++) {
        const struct kiln_field *field = d->fields.entry[i].field;
        if (field->life == life && field->length == KILN_FIELD_EACH)
            status = kiln_redistribute(r->communicator, r->before->of[field->domain], r->after->of[field->domain],
                                       kiln_field_size(field), r->limit, kiln_rank_field(old, &d->fields, i),
                                       kiln_rank_field(&d->data[d->own], &d->fields, i), error);
    }
    if (parts != NULL)
        kiln_rank_regions_destroy(&parts);
    return status;
}

/* Collective, in debug builds. */
static void assert_same_bounds(const struct redistribution *r)
{
    int ranks;
    (void)MPI_Comm_size(r->communicator, &ranks);
    for (int u = 0; u < KILN_DOMAINS; u++) {
        kiln_assert_same_bytes(r->communicator, r->before->of[u], ((size_t)ranks + 1) * sizeof *r->before->of[u],
                               "the ranges that points leave");
        kiln_assert_same_bytes(r->communicator, r->after->of[u], ((size_t)ranks + 1) * sizeof *r->after->of[u],
                               "the ranges that points go to");
    }
    kiln_assert_same(r->communicator, r->limit, "the limit of a message");
}

int kiln_node_data_redistribute(struct kiln_node_data *d, MPI_Comm communicator, const struct kiln_range_bounds *before,
                                const struct kiln_range_bounds *after, uint64_t limit, struct kiln_error *error)
{
    int rank;
    (void)MPI_Comm_rank(communicator, &rank);
    const struct redistribution r = {communicator, before, after, limit};
    assert_same_bounds(&r);
    struct kiln_rank_data old = d->data[d->own];
    const bool built = d->parts[KILN_FIELD_SURFACE] == NULL;
    struct extent own = {.first = {after->of[KILN_DOMAIN_POINT][rank]}};
    for (int u = 0; u < KILN_DOMAINS; u++)
        own.count[u] = after->of[u][rank + 1] - after->of[u][rank];
    kiln_node_data_end(d);
    learn_extents(d, &own);
    int status;
    KILN_TRY(redistribute_life(d, &r, KILN_FIELD_SURFACE, &old, error));
    find_bases(&d->data[d->own].surface);
    if (built)
        free_surface(d, &old);
    take_over_surface(d);
    KILN_TRY(redistribute_life(d, &r, KILN_FIELD_RESULT, &old, error));
    KILN_TRY(kiln_agree(communicator, make_somewhere(d, KILN_FIELD_STEP, error), error));
    if (d->node != NULL)
        kiln_node_wait(d->node);
end:
    return status;
}

uint64_t kiln_node_data_bytes(const struct kiln_node_data *d)
{
    return lay_out(NULL, &d->fields, &d->extents[d->own], KILN_FIELD_SURFACE, NULL) +
           lay_out(NULL, &d->fields, &d->extents[d->own], KILN_FIELD_RESULT, NULL);
}

int kiln_node_data_count(const struct kiln_node_data *d) { return d->count; }
int kiln_node_data_own(const struct kiln_node_data *d) { return d->own; }
const struct kiln_rank_data *kiln_rank_data(const struct kiln_node_data *d, int index) { return &d->data[index]; }
const struct kiln_field_set *kiln_node_data_fields(const struct kiln_node_data *d) { return &d->fields; }
