#include "coordinator/output/map/write/texel_gather.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/exchange.h"
#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/points.h"
#include "worker/base/memory.h"

/* A tile run that is sent for a lightmap: its own, or one that uses its points as ghosts. */
struct shipment {
    size_t tile_run;
    uint32_t map;
};

/* Where the records of a shipment lie in a pass. */
struct place {
    struct shipment shipment;
    size_t at;
};

struct kiln_texel_gather {
    const struct kiln_bake_result *result;
    const struct kiln_assignment *assignment;
    const struct kiln_layers *layers;
    int rank, ranks;
    size_t record; /* bytes */
    size_t limit;  /* records to one rank in a pass; at least those of one tile run */
    const struct kiln_ghosts *ghosts;
    uint64_t *bucket_first; /* rounds x ranks + 1: beginning of the shipments for (round, owner) in `order` */
    uint64_t *cursor;       /* per destination, during a round */
    struct shipment *order; /* shipments of own tile runs, sorted by (round, owner), then by tile run */
    size_t shipment_count;
    uint8_t *out, *in;    /* records */
    struct place *places; /* places in the current pass, one per shipment */
    size_t in_capacity;
    struct kiln_exchange exchange; /* of records for other ranks; own ones lie where they would be sent from */
    size_t own;
};

enum { TILE_ROWS = 8 };

/* The rank that has a tile's texels; for a ghost tile, that of any band. */
static uint32_t rank_of(const struct kiln_texel_gather *e, uint32_t map, uint32_t tile)
{
    const struct kiln_lightmap *lightmap = &e->result->surface->lightmaps[map];
    const uint32_t row = tile / lightmap->tiles_x * TILE_ROWS;
    return e->assignment->owner[map] == KILN_IN_BANDS
               ? kiln_bands_rank(lightmap->height, (uint32_t)e->ranks,
                                 row < lightmap->height ? row : lightmap->height - 1)
               : e->assignment->owner[map];
}

/* The bucket of a lightmap's tile; SIZE_MAX: it has none. */
static size_t bucket_of(const struct kiln_texel_gather *e, uint32_t map, uint32_t tile)
{
    if (e->assignment->owner[map] == KILN_NONE)
        return SIZE_MAX;
    return (size_t)e->assignment->round[map] * (size_t)e->ranks + rank_of(e, map, tile);
}

/* Calls `visit` for all shipments of a tile run. */
static void visit_shipments(struct kiln_texel_gather *e, size_t tile_run,
                            void (*visit)(struct kiln_texel_gather *, const struct shipment *, size_t bucket))
{
    const struct kiln_tile_run *run = &e->result->surface->tile_runs[tile_run];
    size_t first = 0;
    const size_t ghosts = kiln_ghosts_of(e->ghosts, run->map, run->tile, &first);
    for (size_t i = 0; i <= ghosts; i++) {
        const struct shipment shipment = {tile_run, i == 0 ? run->map : e->ghosts->tiles[first + i - 1].to};
        const size_t bucket = bucket_of(e, shipment.map, run->tile);
        if (bucket != SIZE_MAX)
            visit(e, &shipment, bucket);
    }
}

static void count_shipment(struct kiln_texel_gather *e, const struct shipment *shipment, size_t bucket)
{
    (void)shipment;
    e->bucket_first[bucket + 1]++;
    e->shipment_count++;
}

static void list_shipment(struct kiln_texel_gather *e, const struct shipment *shipment, size_t bucket)
{
    e->order[e->bucket_first[bucket]++] = *shipment;
}

static int sort_tile_runs(struct kiln_texel_gather *e, struct kiln_error *error)
{
    const size_t tile_runs = e->result->surface->tile_run_count,
                 buckets = (size_t)e->assignment->rounds * (size_t)e->ranks;
    for (size_t f = 0; f < tile_runs; f++)
        visit_shipments(e, f, count_shipment);
    const int status = kiln_allocate(&e->order, e->shipment_count, sizeof *e->order, "the exchange of points", error);
    if (status != KILN_OK)
        return status;
    for (size_t b = 0; b < buckets; b++)
        e->bucket_first[b + 1] += e->bucket_first[b];
    for (size_t f = 0; f < tile_runs; f++)
        visit_shipments(e, f, list_shipment);
    for (size_t b = buckets; b > 0; b--)
        e->bucket_first[b] = e->bucket_first[b - 1];
    e->bucket_first[0] = 0;
    return KILN_OK;
}

static int allocate_exchange(struct kiln_texel_gather *e, struct kiln_error *error)
{
    const size_t ranks = (size_t)e->ranks;
    int status;
    KILN_TRY(kiln_allocate(&e->bucket_first, (size_t)e->assignment->rounds * ranks + 1, sizeof(uint64_t),
                           "the exchange of points", error));
    KILN_TRY(kiln_allocate(&e->cursor, ranks, sizeof(uint64_t), "the exchange of points", error));
    KILN_TRY(kiln_allocate_bare(&e->out, e->limit * ranks, e->record, "points to send", error));
    /* one place per shipment; `limit` per rank suffice, since each shipment has at least one record */
    KILN_TRY(kiln_allocate_bare(&e->places, e->limit * ranks, sizeof *e->places, "points to send", error));
end:
    return status;
}

int kiln_texel_gather_create(struct kiln_texel_gather **gather, const struct kiln_bake_result *result,
                             const struct kiln_assignment *assignment, const struct kiln_layers *layers,
                             const struct kiln_ghosts *ghosts, size_t records_per_pass, struct kiln_error *error)
{
    struct kiln_texel_gather *e = NULL;
    int status = kiln_allocate(&e, 1, sizeof *e, "the exchange of points", error);
    *gather = e;
    KILN_TRY(kiln_agree(result->communicator, status, error));
    KILN_TRY(kiln_exchange_create(&e->exchange, result->communicator, 0, "points for lightmaps", error));
    e->result = result;
    e->assignment = assignment;
    e->layers = layers;
    e->ghosts = ghosts;
    e->record = sizeof(struct kiln_texel_record) + layers->planes.count * sizeof(float);
    e->rank = e->exchange.rank;
    e->ranks = e->exchange.ranks;
    e->limit = (records_per_pass == 0 ? (size_t)1 << 18 : records_per_pass) / (size_t)e->ranks;
    if (e->limit < KILN_TILE_TEXELS)
        e->limit = KILN_TILE_TEXELS;
    status = allocate_exchange(e, error);
    if (status == KILN_OK)
        status = sort_tile_runs(e, error);
    KILN_TRY(kiln_agree(result->communicator, status, error));
end:
    if (status != KILN_OK)
        kiln_texel_gather_destroy(gather);
    return status;
}

void kiln_texel_gather_destroy(struct kiln_texel_gather **gather)
{
    struct kiln_texel_gather *e = *gather;
    if (e == NULL)
        return;
    kiln_exchange_release(&e->exchange);
    kiln_free(&e->bucket_first);
    kiln_free(&e->cursor);
    kiln_free(&e->order);
    kiln_free(&e->out);
    kiln_free(&e->places);
    kiln_free(&e->in);
    kiln_free(gather);
}

/* Packs position and normal, if a stage reads them. */
static void pack_detail(const struct kiln_texel_gather *e, const struct kiln_point_detail *detail,
                        struct kiln_texel_record *record)
{
    const double *centre = e->result->scene->header->centre;
    for (int c = 0; e->layers->position != 0 && c < 3; c++)
        record->values[e->layers->position + (uint32_t)c] = (float)(detail->position[c] - centre[c]);
    if (e->layers->normal != 0)
        memcpy(record->values + e->layers->normal, detail->normal, sizeof detail->normal);
}

/* Packs the values of an own point in all planes that are fields. */
static int pack_values(const struct kiln_texel_gather *e, struct kiln_own_point point, struct kiln_texel_record *record,
                       struct kiln_error *error)
{
    const struct kiln_bake_result *r = e->result;
    for (size_t i = 0; i < e->layers->count; i++) {
        const struct kiln_layer *layer = &e->layers->layer[i];
        const struct kiln_field *field = r->fields->entry[layer->field].field;
        float floats[KILN_FIELD_COMPONENTS_MAX];
        kiln_rank_floats(r->data, r->fields, layer->field, point, floats);
        for (uint32_t c = 0; record->valid != 0 && c < field->components; c++)
            if (!isfinite(floats[c]))
                return kiln_fail(
                    error, KILN_BUG, "object '%s', texel (%u, %u): the field '%s' is not a finite number there",
                    kiln_scene_string(r->scene, r->scene->objects[kiln_map_object(r->surface, record->from)].name),
                    record->x, record->y, field->name);
        memcpy(record->values + layer->plane, floats, field->components * sizeof *floats);
    }
    return KILN_OK;
}

static int pack_tile_run(const struct kiln_texel_gather *e, const struct shipment *shipment, uint8_t *out,
                         struct kiln_error *error)
{
    const struct kiln_bake_result *r = e->result;
    const size_t tile_run = shipment->tile_run;
    struct kiln_own_point point = kiln_own_of_global(r->surface, r->surface->tile_runs[tile_run].first);
    struct kiln_point_detail details[KILN_TILE_TEXELS];
    const uint32_t count = kiln_tile_run_details(r, tile_run, details);
    int status = KILN_OK;
    for (uint32_t i = 0; i < count && status == KILN_OK; i++, point.at++) {
        struct kiln_texel_record *record = (void *)(out + i * e->record);
        *record = (struct kiln_texel_record){.map = shipment->map,
                                             .from = r->surface->tile_runs[tile_run].map,
                                             .x = details[i].x,
                                             .y = details[i].y,
                                             .triangle = details[i].triangle,
                                             .valid = kiln_point_valid(r->surface, point),
                                             .area = r->surface->area[point.at],
                                             .coverage = details[i].coverage};
        pack_detail(e, &details[i], record);
        status = pack_values(e, point, record, error);
    }
    return status;
}

/* Plans a pass: takes as many shipments for each rank as fit. *more tells whether some are left. Returns their number.
 */
static size_t plan_pass(struct kiln_texel_gather *e, uint32_t round, int *more)
{
    size_t total = 0, count = 0;
    *more = 0;
    for (int rank = 0; rank < e->ranks; rank++) {
        const uint64_t end = e->bucket_first[(size_t)round * (size_t)e->ranks + (size_t)rank + 1];
        e->exchange.sent_at[rank] = total;
        size_t packed = 0;
        for (; e->cursor[rank] < end; e->cursor[rank]++) {
            const struct shipment shipment = e->order[e->cursor[rank]];
            const uint32_t points = e->result->surface->tile_runs[shipment.tile_run].count;
            if (packed + points > e->limit)
                break;
            e->places[count++] = (struct place){.shipment = shipment, .at = total + packed};
            packed += points;
        }
        *more = *more || e->cursor[rank] < end;
        e->exchange.sent[rank] = packed;
        total += packed;
    }
    e->own = e->exchange.sent[e->rank];
    e->exchange.sent[e->rank] = 0;
    return count;
}

static int pack_pass(struct kiln_texel_gather *e, uint32_t round, int *more, struct kiln_error *error)
{
    const size_t count = plan_pass(e, round, more);
    int status = KILN_OK;
#pragma omp parallel for schedule(dynamic, 32)
    for (size_t i = 0; i < count; i++) {
        struct kiln_error mine = {{0}};
        const int result = pack_tile_run(e, &e->places[i].shipment, e->out + e->places[i].at * e->record, &mine);
        if (result == KILN_OK)
            continue;
#pragma omp critical(kiln_pack_pass)
        status = kiln_fail(error, result, "%s", mine.message);
    }
    return status;
}

/* Makes room for the records of this pass, in place of those of the pass before. */
static int make_room(struct kiln_texel_gather *e, size_t records, struct kiln_error *error)
{
    if (records <= e->in_capacity)
        return KILN_OK;
    kiln_free(&e->in);
    e->in_capacity = 0;
    const int status = kiln_allocate_bare(&e->in, records, e->record, "points received", error);
    e->in_capacity = status == KILN_OK ? records : 0;
    return status;
}

static void put_all(const struct kiln_texel_gather *e, const uint8_t *records, size_t count,
                    void (*put)(void *, const struct kiln_texel_record *), void *context)
{
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++)
        put(context, (const void *)(records + i * e->record));
}

/* Collective. Sends records for other ranks; puts own ones meanwhile, then those that have come. */
static int pass(struct kiln_texel_gather *e, int status, void (*put)(void *, const struct kiln_texel_record *),
                void *context, struct kiln_error *error)
{
    struct kiln_exchange *x = &e->exchange;
    KILN_TRY(kiln_exchange_count(x, status, error));
    status = make_room(e, x->got_all, error);
    KILN_TRY(kiln_exchange_begin(x, status, e->record, e->out, e->in, error));
    put_all(e, e->out + x->sent_at[e->rank] * e->record, e->own, put, context);
    KILN_TRY(kiln_exchange_end(x, KILN_OK, error));
    put_all(e, e->in, x->got_all, put, context);
end:
    return status;
}

int kiln_texel_gather_round(struct kiln_texel_gather *e, uint32_t round,
                            void (*put)(void *, const struct kiln_texel_record *), void *context,
                            struct kiln_error *error)
{
    for (int r = 0; r < e->ranks; r++)
        e->cursor[r] = e->bucket_first[(size_t)round * (size_t)e->ranks + (size_t)r];
    for (int more = 1; more != 0;) {
        int mine = 0;
        const int status = pass(e, pack_pass(e, round, &mine, error), put, context, error);
        if (status != KILN_OK)
            return status;
        if (MPI_Allreduce(&mine, &more, 1, MPI_INT, MPI_MAX, e->result->communicator) != MPI_SUCCESS)
            return kiln_fail(error, KILN_RANK_LOST, "MPI failed while points were sent to the ranks that write them");
    }
    return KILN_OK;
}
