#include "coordinator/output/map/seams/joined.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/exchange.h"
#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/charts/dilate.h"
#include "coordinator/output/map/seams/seam_samples.h"
#include "worker/base/memory.h"

enum { SIDE = KILN_SEAM_SIDE, ENTRIES = KILN_SEAM_ENTRIES };

/* A texel that samples read. */
struct texel {
    uint32_t map, at;
    uint32_t part; /* of a solution: the part of the group that solved these values (parts_of) */
    float area;
    float values[]; /* of the planes that are smoothed */
};

/* One side of a sample, at a seam of one map or at a joint of two. */
struct half_sample {
    uint32_t map;
    uint32_t joint, edge; /* number of the joint; or KILN_NONE, and number of the seam in the map */
    uint32_t index, side;
    uint32_t at[SIDE]; /* texels of the map */
    float weight[SIDE];
};

/* Kinds of records that are sent to the solving ranks. */
enum kind { TEXELS, HALF_SAMPLES, KINDS };

struct records {
    size_t size, count, capacity; /* size: of one, bytes */
    unsigned char *at;
};

/* A group that this rank solves a part of. */
struct solved {
    uint32_t group, part;
    struct kiln_seam_system *system;
    uint32_t *maps, *texels; /* of each unknown */
    struct own {             /* samples of one map, one after the other */
        uint32_t map;
        size_t first, count;
    } * own;
    size_t own_count, own_capacity;
};

struct kiln_joined {
    struct kiln_joined_params params;
    int rank, ranks;
    uint32_t plane_count;        /* those that are smoothed */
    uint8_t *wide;               /* one per lightmap: 1 if its group has a map in bands */
    size_t *first;               /* per lightmap, and the end: where its entries in `joints_of` begin */
    uint32_t *joints_of;         /* numbers of joints */
    struct records kinds[KINDS]; /* records of own maps; later of the groups that this rank solves */
    struct records solution;     /* texels of own maps, sorted by map and texel */
    struct solved *solved;
    size_t solved_count, solved_capacity;
    size_t map_count;
    struct kiln_joined_report *reports; /* one per lightmap; if a map is alone, only the first */
};

static void *record_at(const struct records *records, size_t i) { return records->at + i * records->size; }

static void drop_records(struct records *records)
{
    kiln_free(&records->at);
    records->count = records->capacity = 0;
}

static void drop_solved(struct solved *s)
{
    kiln_seam_system_destroy(&s->system);
    kiln_free(&s->maps);
    kiln_free(&s->texels);
    kiln_free(&s->own);
}

/* ---- groups ---- */

static bool is_alone(const struct kiln_joined *j) { return j->params.joints == NULL; }

static bool in_bands(const struct kiln_joined *j, uint32_t map)
{
    return j->params.assignment->owner[map] == KILN_IN_BANDS;
}

static uint32_t group_of(const struct kiln_joined *j, uint32_t map)
{
    return is_alone(j) ? map : j->params.joints->group[map];
}

static bool is_wide(const struct kiln_joined *j, uint32_t group) { return is_alone(j) || j->wide[group] != 0; }

/* Number of ranks that solve a group, each with some of its planes. */
static uint32_t parts_of(const struct kiln_joined *j, uint32_t group)
{
    return !is_wide(j, group) ? 1 : (uint32_t)j->ranks < j->plane_count ? (uint32_t)j->ranks : j->plane_count;
}

static int solver_of(const struct kiln_joined *j, uint32_t group, uint32_t part)
{
    return is_wide(j, group) ? (int)(((uint64_t)group + part) % (uint64_t)j->ranks)
                             : (int)j->params.assignment->owner[group];
}

/* The rank that has the texel. */
static int home_of(const struct kiln_joined *j, uint32_t map, uint32_t texel)
{
    const struct kiln_lightmap *lightmap = &j->params.lightmaps[map];
    return in_bands(j, map) ? (int)kiln_bands_rank(lightmap->height, (uint32_t)j->ranks, texel / lightmap->width)
                            : (int)j->params.assignment->owner[map];
}

/* Lists the joints of each lightmap, and finds the groups with a map in bands. */
static int index_joints(struct kiln_joined *j, struct kiln_error *error)
{
    const struct kiln_joints *joints = j->params.joints;
    int status;
    KILN_TRY(kiln_allocate(&j->first, joints->map_count + 1, sizeof *j->first, "joints of objects", error));
    KILN_TRY(kiln_allocate(&j->joints_of, 2 * joints->count, sizeof *j->joints_of, "joints of objects", error));
    KILN_TRY(kiln_allocate(&j->wide, joints->map_count, 1, "joints of objects", error));
end:
    if (status != KILN_OK)
        return status;
    for (size_t m = 0; m < joints->map_count; m++)
        if (joints->group[m] != KILN_NONE && in_bands(j, (uint32_t)m))
            j->wide[joints->group[m]] = 1;
    for (size_t i = 0; i < joints->count; i++)
        for (int side = 0; side < 2; side++)
            j->first[joints->joints[i].map[side]]++;
    for (size_t m = 0, sum = 0; m <= joints->map_count; m++) { /* where the next lightmap begins */
        sum += j->first[m];
        j->first[m] = sum;
    }
    for (size_t i = joints->count; i-- > 0;)
        for (int side = 0; side < 2; side++)
            j->joints_of[--j->first[joints->joints[i].map[side]]] = (uint32_t)i;
    return KILN_OK;
}

int kiln_joined_create(struct kiln_joined **joined, const struct kiln_joined_params *params, struct kiln_error *error)
{
    int status = kiln_allocate(joined, 1, sizeof **joined, "joined seams", error);
    if (status != KILN_OK)
        return status;
    struct kiln_joined *j = *joined;
    j->params = *params;
    j->plane_count = kiln_map_smooth_planes(params->planes);
    j->kinds[TEXELS].size = j->solution.size = sizeof(struct texel) + j->plane_count * sizeof(float);
    j->kinds[HALF_SAMPLES].size = sizeof(struct half_sample);
    j->map_count = is_alone(j) ? 1 : params->joints->map_count;
    if (MPI_Comm_rank(params->communicator, &j->rank) != MPI_SUCCESS ||
        MPI_Comm_size(params->communicator, &j->ranks) != MPI_SUCCESS)
        status = kiln_fail(error, KILN_RANK_LOST, "MPI cannot give the rank number");
    if (status == KILN_OK)
        status = kiln_allocate(&j->reports, j->map_count, sizeof *j->reports, "joined seams", error);
    if (status == KILN_OK && !is_alone(j))
        status = index_joints(j, error);
    if (status != KILN_OK)
        kiln_joined_destroy(joined);
    return status;
}

void kiln_joined_destroy(struct kiln_joined **joined)
{
    struct kiln_joined *j = *joined;
    if (j == NULL)
        return;
    for (int k = 0; k < KINDS; k++)
        drop_records(&j->kinds[k]);
    drop_records(&j->solution);
    for (size_t i = 0; i < j->solved_count; i++)
        drop_solved(&j->solved[i]);
    kiln_free(&j->solved);
    kiln_free(&j->first);
    kiln_free(&j->joints_of);
    kiln_free(&j->wide);
    kiln_free(&j->reports);
    kiln_free(joined);
}

static struct kiln_joined_report *report_of(const struct kiln_joined *j, uint32_t number)
{
    return &j->reports[is_alone(j) ? 0 : number];
}

const struct kiln_joined_report *kiln_joined_report(const struct kiln_joined *j, uint32_t number)
{
    return report_of(j, number);
}

/* ---- what a map adds ---- */

/* A map, or a band of it, with the samples that read it. */
struct part {
    uint32_t number;
    const struct kiln_map *map;
    struct half_sample *halves;
    size_t half_count, half_capacity, texel_count;
    uint32_t *marks, *texels;
};

/* Whether the first row that a sample at `y` reads belongs to the map. */
static bool reads_own_row(const struct kiln_map *map, float y)
{
    const float row = floorf(y - 0.5f);
    const int64_t at = row < 0.0f ? 0 : row >= (float)map->height ? map->height - 1 : (int64_t)row;
    return at >= map->first_row && at < map->end_row;
}

/* Adds the half samples of one side of an edge; `like` holds the members that they share. */
static int add_halves(struct part *p, const struct kiln_seam_edge *edge, const struct half_sample *like,
                      const uint32_t *nearest, struct kiln_error *error)
{
    const size_t count = kiln_seam_sample_count(edge);
    const float *from = edge->texel[like->side][0], *to = edge->texel[like->side][1];
    if (p->map->bands != NULL &&
        (fmaxf(from[1], to[1]) < (float)p->map->first_row - 2.0f ||
         fminf(from[1], to[1]) > (float)p->map->end_row + 2.0f) &&
        p->map->first_row > 0 && p->map->end_row < p->map->height)
        return KILN_OK; /* of other bands */
    const int status =
        kiln_grow(&p->halves, &p->half_capacity, p->half_count + count, sizeof *p->halves, "seam samples", error);
    for (size_t i = 0; status == KILN_OK && i < count; i++) {
        const float t = kiln_seam_sample_place(i, count), x = from[0] + t * (to[0] - from[0]),
                    y = from[1] + t * (to[1] - from[1]);
        struct half_sample *half = &p->halves[p->half_count];
        *half = *like;
        half->index = (uint32_t)i;
        if (reads_own_row(p->map, y))
            p->half_count +=
                kiln_seam_footprint(p->map, nearest, x, y, like->side == 0 ? 1.0f : -1.0f, half->at, half->weight);
    }
    return status;
}

/* The sides at the map's own seams. */
static int add_seams(struct part *p, const struct kiln_chart_graph *graph, const uint32_t *nearest,
                     struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < graph->edge_count && status == KILN_OK; i++)
        for (uint32_t side = 0; side < 2 && status == KILN_OK; side++) {
            const struct half_sample like = {.map = p->number, .joint = KILN_NONE, .edge = (uint32_t)i, .side = side};
            status = add_halves(p, &graph->edges[i], &like, nearest, error);
        }
    return status;
}

static int add_joint(const struct kiln_joined *j, struct part *p, uint32_t joint, const uint32_t *nearest,
                     struct kiln_error *error)
{
    const struct kiln_joint *at = &j->params.joints->joints[joint];
    const struct half_sample like = {.map = p->number, .joint = joint, .side = at->map[0] == p->number ? 0 : 1};
    return add_halves(p, &at->edge, &like, nearest, error);
}

/* The texels that the samples read. */
static int list_texels(struct part *p, struct kiln_error *error)
{
    const int status = kiln_map_allocate(p->map, &p->marks, sizeof *p->marks, "a seam's texels", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < p->half_count; i++)
        for (int k = 0; k < SIDE; k++)
            p->marks[p->halves[i].at[k]] = 1;
    return kiln_seams_number(p->map, p->marks, &p->texels, &p->texel_count, error);
}

static void copy_texel(const struct kiln_joined *j, const struct part *p, uint32_t at, struct texel *texel)
{
    *texel = (struct texel){.map = p->number, .at = at, .area = p->map->area[at]};
    for (uint32_t plane = 0, to = 0; plane < j->params.planes->count; plane++)
        if (j->params.planes->smooth[plane])
            texel->values[to++] = p->map->planes[plane][at];
}

static int make_room(struct records *records, size_t more, struct kiln_error *error)
{
    return kiln_grow(&records->at, &records->capacity, records->count + more, records->size, "joined seams", error);
}

/* Copies a part to the records. One thread at a time. */
static int hand_over(struct kiln_joined *j, const struct part *p, struct kiln_error *error)
{
    struct records *kinds = j->kinds;
    int status = make_room(&kinds[TEXELS], p->texel_count, error);
    if (status == KILN_OK)
        status = make_room(&kinds[HALF_SAMPLES], p->half_count, error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < p->texel_count; i++)
        copy_texel(j, p, p->texels[i], record_at(&kinds[TEXELS], kinds[TEXELS].count++));
    for (size_t i = 0; i < p->half_count; i++)
        *(struct half_sample *)record_at(&kinds[HALF_SAMPLES], kinds[HALF_SAMPLES].count++) = p->halves[i];
    return KILN_OK;
}

/* Gets the row below a band, which samples read, with values in its margin. */
static int bring_row(struct kiln_map *map, const uint32_t *nearest, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_map_dilate(map, nearest, NULL, error));
    KILN_TRY(kiln_bands_halo(map, KILN_BANDS_PLANES, 1, error));
    KILN_TRY(kiln_bands_halo_of(map, map->area, sizeof *map->area, 1, error));
end:
    return status;
}

int kiln_joined_add(struct kiln_joined *j, uint32_t number, struct kiln_map *map, const struct kiln_chart_graph *graph,
                    const uint32_t *nearest, struct kiln_error *error)
{
    struct part part = {.number = number, .map = map};
    int status = bring_row(map, nearest, error);
    if (status == KILN_OK)
        status = add_seams(&part, graph, nearest, error);
    for (size_t i = is_alone(j) ? 0 : j->first[number]; !is_alone(j) && status == KILN_OK && i < j->first[number + 1];
         i++)
        status = add_joint(j, &part, j->joints_of[i], nearest, error);
    if (status == KILN_OK)
        status = list_texels(&part, error);
    if (status == KILN_OK) {
#pragma omp critical(kiln_joined_add)
        status = hand_over(j, &part, error);
    }
    kiln_free(&part.halves);
    kiln_map_free(map, &part.marks, sizeof *part.marks);
    kiln_free(&part.texels);
    return kiln_bands_agree(map, status, error);
}

/* ---- messages ---- */

/* The lightmap that a record belongs to. */
static uint32_t map_of(enum kind kind, const void *record)
{
    return kind == TEXELS ? ((const struct texel *)record)->map : ((const struct half_sample *)record)->map;
}

/* Destinations other than a part of the group. HOME: the rank that has the texel. */
#define HOME UINT32_MAX
#define REPORT (UINT32_MAX - 1) /* to the rank that solves part 0, if the group has a map in bands */

static int target_of(const struct kiln_joined *j, enum kind kind, const void *record, uint32_t part)
{
    const uint32_t map = map_of(kind, record), group = group_of(j, map);
    if (part == HOME)
        return home_of(j, map, ((const struct texel *)record)->at);
    if (part == REPORT)
        return is_wide(j, group) ? solver_of(j, group, 0) : -1;
    return part < parts_of(j, group) ? solver_of(j, group, part) : -1;
}

/* Sorts records by the rank that they go to, in their order. targets: of each record its rank; -1: none. */
static int sort_out(struct kiln_exchange *e, const struct records *records, const int *targets, unsigned char **sorted,
                    struct kiln_error *error)
{
    for (size_t i = 0; i < records->count; i++)
        if (targets[i] >= 0)
            e->sent[targets[i]]++;
    kiln_exchange_lay_out(e);
    const int status = kiln_allocate_bare(sorted, e->sent_all, records->size, "joined seams", error);
    for (size_t i = 0; i < records->count && status == KILN_OK; i++)
        if (targets[i] >= 0)
            memcpy(*sorted + e->sent_at[targets[i]]++ * records->size, record_at(records, i), records->size);
    kiln_exchange_lay_out(e);
    return status;
}

/* Collective. Sends records to the ranks that `part` selects; received ones are appended to `in`. */
static int travel(const struct kiln_joined *j, enum kind kind, const struct records *records, uint32_t part,
                  struct records *in, struct kiln_error *error)
{
    struct kiln_exchange e;
    unsigned char *sorted = NULL;
    int *targets = NULL, status;
    KILN_TRY(kiln_exchange_create(&e, j->params.communicator, 0, "texels at seams of objects that touch", error));
    status = kiln_allocate(&targets, records->count, sizeof *targets, "joined seams", error);
    for (size_t i = 0; i < records->count && status == KILN_OK; i++)
        targets[i] = target_of(j, kind, record_at(records, i), part);
    if (status == KILN_OK)
        status = sort_out(&e, records, targets, &sorted, error);
    KILN_TRY(kiln_exchange_count(&e, status, error));
    status = e.got_all > INT_MAX /* they get numbers of 32 bits */
                 ? kiln_fail(error, KILN_SYSTEM,
                             "too many texels at seams of objects that touch come to one rank; use --no-stitch")
                 : make_room(in, e.got_all, error);
    KILN_TRY(kiln_exchange_send(&e, status, records->size, sorted, record_at(in, in->count), error));
    in->count += e.got_all;
end:
    kiln_exchange_release(&e);
    kiln_free(&targets);
    kiln_free(&sorted);
    return status;
}

/* ---- order ---- */

static int order_of(uint64_t a, uint64_t b) { return (a > b) - (a < b); }

static int order_texels(const struct kiln_joined *j, const struct texel *p, const struct texel *q)
{
    const int groups = order_of(group_of(j, p->map), group_of(j, q->map)), maps = order_of(p->map, q->map);
    return groups != 0 ? groups : maps != 0 ? maps : order_of(p->at, q->at);
}

static int compare_texels(const void *a, const void *b, void *context)
{
    const int order = order_texels(context, a, b);
    return order != 0 ? order : order_of(((const struct texel *)a)->part, ((const struct texel *)b)->part);
}

/* Seams of single maps come before joints. */
static int compare_halves(const void *a, const void *b, void *context)
{
    const struct kiln_joined *j = context;
    const struct half_sample *p = a, *q = b;
    const bool seam = p->joint == KILN_NONE;
    const int groups = order_of(group_of(j, p->map), group_of(j, q->map)),
              kinds = (q->joint == KILN_NONE) - (p->joint == KILN_NONE);
    if (groups != 0 || kinds != 0)
        return groups != 0 ? groups : kinds;
    const int maps = seam ? order_of(p->map, q->map) : 0,
              edges = seam ? order_of(p->edge, q->edge) : order_of(p->joint, q->joint),
              places = order_of(p->index, q->index);
    return maps != 0 ? maps : edges != 0 ? edges : places != 0 ? places : order_of(p->side, q->side);
}

static void sort_records(struct kiln_joined *j, const struct records *records,
                         int (*compare)(const void *, const void *, void *))
{
    if (records->count > 1)
        qsort_r(records->at, records->count, records->size, compare, j);
}

/* Removes duplicate texels: a row may arrive from its own band and from the band above. */
static void drop_doubles(const struct kiln_joined *j, struct records *texels)
{
    size_t kept = 0;
    for (size_t i = 0; i < texels->count; i++) {
        if (kept > 0 && order_texels(j, record_at(texels, kept - 1), record_at(texels, i)) == 0)
            continue;
        if (kept != i)
            memcpy(record_at(texels, kept), record_at(texels, i), texels->size);
        kept++;
    }
    texels->count = kept;
}

/* ---- a group's system ---- */

/* The records of one group: places [first, end) of each kind. */
struct group {
    uint32_t number;
    size_t first[KINDS], end[KINDS];
};

static void find_end(const struct kiln_joined *j, struct group *g)
{
    for (int k = 0; k < KINDS; k++) {
        const struct records *records = &j->kinds[k];
        g->end[k] = g->first[k];
        while (g->end[k] < records->count &&
               group_of(j, map_of((enum kind)k, record_at(records, g->end[k]))) == g->number)
            g->end[k]++;
    }
}

static const struct half_sample *half_at(const struct kiln_joined *j, size_t i)
{
    return record_at(&j->kinds[HALF_SAMPLES], i);
}

/* The number of a texel in its group; KILN_NONE if it is not there. */
static uint32_t number_of(const struct solved *s, uint32_t map, uint32_t at)
{
    size_t low = 0, high = s->system->unknown_count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (s->maps[middle] < map || (s->maps[middle] == map && s->texels[middle] < at))
            low = middle + 1;
        else
            high = middle;
    }
    return low < s->system->unknown_count && s->maps[low] == map && s->texels[low] == at ? (uint32_t)low : KILN_NONE;
}

/* Joins two half samples to a sample, with numbers of unknowns instead of texels. False if a texel is missing. */
static bool make_sample(const struct solved *s, const struct half_sample *half, const struct half_sample *other,
                        struct kiln_seam_sample *sample)
{
    bool good = true;
    for (int k = 0; k < SIDE; k++) {
        sample->at[k] = number_of(s, half->map, half->at[k]);
        sample->at[SIDE + k] = number_of(s, other->map, other->at[k]);
        good = good && sample->at[k] != KILN_NONE && sample->at[SIDE + k] != KILN_NONE;
    }
    memcpy(sample->weight, half->weight, sizeof half->weight);
    memcpy(sample->weight + SIDE, other->weight, sizeof other->weight);
    return good;
}

static bool belong_together(const struct half_sample *p, const struct half_sample *q)
{
    const bool same =
        p->joint == KILN_NONE ? q->joint == KILN_NONE && p->map == q->map && p->edge == q->edge : p->joint == q->joint;
    return same && p->index == q->index && p->side != q->side;
}

/* Counts a sample among those of its map. */
static int count_own(struct solved *s, uint32_t map, size_t sample, struct kiln_error *error)
{
    if (s->own_count == 0 || s->own[s->own_count - 1].map != map) {
        const int status =
            kiln_grow(&s->own, &s->own_capacity, s->own_count + 1, sizeof *s->own, "joined seams", error);
        if (status != KILN_OK)
            return status;
        s->own[s->own_count++] = (struct own){.map = map, .first = sample};
    }
    s->own[s->own_count - 1].count++;
    return KILN_OK;
}

/* Adds the samples of a group. The two halves of a sample follow one another, unless one side has no surface there.
 * Sets `used` for unknowns that samples read, or that any half at a joint reads. */
static int add_samples(const struct kiln_joined *j, const struct group *g, struct solved *s, uint8_t *used,
                       struct kiln_error *error)
{
    struct kiln_seam_system *system = s->system;
    int status = KILN_OK;
    for (size_t i = g->first[HALF_SAMPLES]; status == KILN_OK && i < g->end[HALF_SAMPLES]; i++) {
        const struct half_sample *half = half_at(j, i);
        const bool seam = half->joint == KILN_NONE;
        for (int k = 0; k < SIDE && !seam; k++) {
            const uint32_t number = number_of(s, half->map, half->at[k]);
            if (number != KILN_NONE)
                used[number] = 1;
        }
        if (i + 1 == g->end[HALF_SAMPLES] || !belong_together(half, half + 1))
            continue;
        struct kiln_seam_sample sample;
        if (!make_sample(s, half, half + 1, &sample))
            return kiln_fail(error, KILN_BUG, "a texel at a seam of the group of lightmap %u did not arrive",
                             g->number);
        if ((seam && kiln_seam_same_texels(&sample)) || kiln_seam_edge_of_light(system->planes, &sample))
            continue;
        for (int k = 0; k < ENTRIES; k++)
            used[sample.at[k]] = 1;
        if (seam)
            status = count_own(s, half->map, system->sample_count, error);
        system->samples[system->sample_count++] = sample;
    }
    return status;
}

/* Removes unknowns that nothing reads: they would distort the mean area. */
static void leave_out_unused(struct solved *s, const uint8_t *used, uint32_t *numbers)
{
    struct kiln_seam_system *system = s->system;
    size_t kept = 0;
    for (size_t i = 0; i < system->unknown_count; i++) {
        numbers[i] = (uint32_t)kept;
        if (used[i] == 0)
            continue;
        s->maps[kept] = s->maps[i];
        s->texels[kept] = s->texels[i];
        system->area[kept] = system->area[i];
        for (uint32_t p = 0; p < system->plane_count; p++)
            system->planes[p][kept] = system->planes[p][i];
        kept++;
    }
    system->unknown_count = kept;
    for (size_t i = 0; i < system->sample_count; i++)
        for (int k = 0; k < ENTRIES; k++)
            system->samples[i].at[k] = numbers[system->samples[i].at[k]];
}

static void take_texels(const struct kiln_joined *j, const struct group *g, struct solved *s)
{
    for (size_t i = 0; i < s->system->unknown_count; i++) {
        const struct texel *texel = record_at(&j->kinds[TEXELS], g->first[TEXELS] + i);
        s->maps[i] = texel->map;
        s->texels[i] = texel->at;
        s->system->area[i] = texel->area;
        for (uint32_t p = 0; p < s->system->plane_count; p++)
            s->system->planes[p][i] = texel->values[p];
    }
}

static int make_system(const struct kiln_joined *j, const struct group *g, struct solved *s, struct kiln_error *error)
{
    const size_t unknowns = g->end[TEXELS] - g->first[TEXELS], halves = g->end[HALF_SAMPLES] - g->first[HALF_SAMPLES];
    uint8_t *used = NULL;
    uint32_t *numbers = NULL;
    int status;
    KILN_TRY(kiln_seam_system_create(&s->system, unknowns, halves / 2, j->plane_count, error));
    KILN_TRY(kiln_allocate(&s->maps, unknowns, sizeof *s->maps, "joined seams", error));
    KILN_TRY(kiln_allocate(&s->texels, unknowns, sizeof *s->texels, "joined seams", error));
    KILN_TRY(kiln_allocate(&used, unknowns, 1, "joined seams", error));
    KILN_TRY(kiln_allocate(&numbers, unknowns, sizeof *numbers, "joined seams", error));
    take_texels(j, g, s);
    s->system->sample_count = 0;
    KILN_TRY(add_samples(j, g, s, used, error));
    leave_out_unused(s, used, numbers);
end:
    kiln_free(&used);
    kiln_free(&numbers);
    return status;
}

/* ---- solving ---- */

/* Reports differences at the seams of maps in bands, on the rank that solves part 0. */
static void report_differences(const struct kiln_joined *j, const struct solved *s, bool after)
{
    for (size_t i = 0; s->part == 0 && i < s->own_count; i++) {
        const struct own *own = &s->own[i];
        struct kiln_joined_report *report = report_of(j, own->map);
        if (!in_bands(j, own->map))
            continue;
        report->samples = own->count;
        *(after ? &report->after : &report->before) =
            kiln_seam_difference(s->system->planes, s->system->samples + own->first, own->count);
    }
}

/* Whether there is anything to change: a lone map's seams may be equal already. */
static bool is_to_solve(const struct kiln_joined *j, const struct kiln_seam_system *system)
{
    return !is_alone(j) ||
           (!j->params.measure && kiln_seam_difference(system->planes, system->samples, system->sample_count) > 0.0);
}

/* Appends the values of all unknowns to the records that are sent back. */
static int add_solution(const struct kiln_joined *j, const struct solved *s, struct records *out,
                        struct kiln_error *error)
{
    const int status = make_room(out, s->system->unknown_count, error);
    for (size_t i = 0; status == KILN_OK && i < s->system->unknown_count; i++) {
        struct texel *texel = record_at(out, out->count++);
        *texel = (struct texel){.map = s->maps[i], .at = s->texels[i], .part = s->part};
        for (uint32_t p = 0; p < j->plane_count; p++)
            texel->values[p] = s->system->planes[p][i];
    }
    return status;
}

static int solve_group(struct kiln_joined *j, const struct group *g, struct records *out, struct kiln_error *error)
{
    const uint32_t ranks = (uint32_t)j->ranks, parts = parts_of(j, g->number);
    struct solved s = {.group = g->number};
    if (is_wide(j, g->number))
        s.part = ((uint32_t)j->rank + ranks - g->number % ranks) % ranks;
    int status;
    KILN_TRY(make_system(j, g, &s, error));
    report_differences(j, &s, false);
    if (is_to_solve(j, s.system))
        KILN_TRY(kiln_seam_system_solve(s.system, s.part, parts, error));
    KILN_TRY(add_solution(j, &s, out, error));
    if (is_wide(j, g->number) && s.part == 0) {
        KILN_TRY(kiln_grow(&j->solved, &j->solved_capacity, j->solved_count + 1, sizeof s, "joined seams", error));
        j->solved[j->solved_count++] = s;
        return KILN_OK;
    }
end:
    drop_solved(&s);
    return status;
}

static int solve_groups(struct kiln_joined *j, struct records *out, struct kiln_error *error)
{
    struct group group = {0};
    int status = KILN_OK;
    sort_records(j, &j->kinds[TEXELS], compare_texels);
    sort_records(j, &j->kinds[HALF_SAMPLES], compare_halves);
    drop_doubles(j, &j->kinds[TEXELS]);
    while (status == KILN_OK && group.first[TEXELS] < j->kinds[TEXELS].count) {
        group.number = group_of(j, map_of(TEXELS, record_at(&j->kinds[TEXELS], group.first[TEXELS])));
        find_end(j, &group);
        status = solve_group(j, &group, out, error);
        memcpy(group.first, group.end, sizeof group.first);
    }
    return status;
}

/* Copies values that other parts have solved into a system; records are in the order of its unknowns. */
static void take_parts(const struct kiln_joined *j, struct solved *s, const struct records *parts, size_t *next)
{
    const uint32_t count = parts_of(j, s->group);
    for (; *next < parts->count; *next += 1) {
        const struct texel *texel = record_at(parts, *next);
        if (group_of(j, texel->map) != s->group)
            return;
        const uint32_t number = number_of(s, texel->map, texel->at);
        for (uint32_t p = texel->part; number != KILN_NONE && p < j->plane_count; p += count)
            s->system->planes[p][number] = texel->values[p];
    }
}

/* Collective. Tells all ranks the differences at the seams of maps in bands. */
static int share_reports(struct kiln_joined *j, const struct records *solution, struct kiln_error *error)
{
    enum { AT_ONCE = 1 << 16 };
    struct records parts = {.size = solution->size};
    size_t next = 0;
    int status = travel(j, TEXELS, solution, REPORT, &parts, error);
    if (status == KILN_OK) {
        sort_records(j, &parts, compare_texels);
        for (size_t i = 0; i < j->solved_count; i++) {
            take_parts(j, &j->solved[i], &parts, &next);
            report_differences(j, &j->solved[i], true);
        }
    }
    drop_records(&parts);
    for (size_t first = 0; status == KILN_OK && first < j->map_count; first += AT_ONCE) {
        const size_t left = j->map_count - first, count = left < AT_ONCE ? left : AT_ONCE;
        if (MPI_Allreduce(MPI_IN_PLACE, j->reports + first, (int)(count * sizeof *j->reports), MPI_BYTE, MPI_BOR,
                          j->params.communicator) != MPI_SUCCESS)
            status = kiln_fail(error, KILN_RANK_LOST, "MPI failed while seams of objects were joined");
    }
    return status;
}

/* The number of a group that has a map in bands; KILN_NONE: there is none. */
static uint32_t wide_group(const struct kiln_joined *j)
{
    if (is_alone(j))
        return j->params.alone;
    for (size_t m = 0; m < j->map_count; m++)
        if (j->wide[m] != 0)
            return (uint32_t)m;
    return KILN_NONE;
}

/* Collective. Sends the records of all maps to the ranks that solve. */
static int send_all(struct kiln_joined *j, struct kiln_error *error)
{
    const uint32_t wide = wide_group(j), parts = wide != KILN_NONE ? parts_of(j, wide) : 1;
    int status = KILN_OK;
    for (int k = 0; status == KILN_OK && k < KINDS; k++) {
        struct records in = {.size = j->kinds[k].size};
        for (uint32_t part = 0; status == KILN_OK && part < parts; part++)
            status = travel(j, (enum kind)k, &j->kinds[k], part, &in, error);
        drop_records(&j->kinds[k]);
        j->kinds[k] = in;
    }
    return status;
}

int kiln_joined_solve(struct kiln_joined *j, struct kiln_error *error)
{
    struct records out = {.size = j->solution.size};
    int status = send_all(j, error);
    if (status == KILN_OK)
        status = kiln_agree(j->params.communicator, solve_groups(j, &out, error), error);
    for (int k = 0; k < KINDS; k++)
        drop_records(&j->kinds[k]);
    drop_records(&j->solution);
    if (status == KILN_OK)
        status = travel(j, TEXELS, &out, HOME, &j->solution, error);
    if (status == KILN_OK && wide_group(j) != KILN_NONE)
        status = share_reports(j, &out, error);
    drop_records(&out);
    if (status == KILN_OK)
        sort_records(j, &j->solution, compare_texels);
    return status;
}

/* Whether the texel's lightmap comes before lightmap `number` in the order of the solution. */
static bool is_before(const struct kiln_joined *j, const struct texel *texel, uint32_t number)
{
    const int groups = order_of(group_of(j, texel->map), group_of(j, number));
    return groups < 0 || (groups == 0 && texel->map < number);
}

void kiln_joined_apply(const struct kiln_joined *j, uint32_t number, struct kiln_map *map, uint32_t *nearest)
{
    const uint32_t parts = parts_of(j, group_of(j, number));
    size_t low = 0, high = j->solution.count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (is_before(j, record_at(&j->solution, middle), number))
            low = middle + 1;
        else
            high = middle;
    }
    for (; low < j->solution.count; low++) {
        const struct texel *texel = record_at(&j->solution, low);
        if (texel->map != number)
            return;
        for (uint32_t plane = 0, from = 0; plane < j->params.planes->count; plane++)
            if (j->params.planes->smooth[plane]) {
                if (from % parts == texel->part)
                    kiln_seam_set(map, nearest, plane, texel->at, texel->values[from]);
                from++;
            }
    }
}
