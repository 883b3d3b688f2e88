#include "coordinator/output/map/joined.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/output/map/seams.h"
#include "worker/base/memory.h"

enum { SIDE = KILN_SEAM_SIDE, ENTRIES = KILN_SEAM_ENTRIES };

/* A texel that samples read. */
struct texel {
    uint32_t map, at;
    float area;
    float values[]; /* of the planes that are smoothed */
};

/* A sample at a seam of one map; its entries are texels of the map. */
struct own_sample {
    uint32_t map, index;
    struct kiln_seam_sample sample;
};

/* One side of a sample at a joint. */
struct half_sample {
    uint32_t joint, index, side;
    uint32_t at[SIDE]; /* texels of the side's map */
    float weight[SIDE];
};

/* What is sent to the ranks that solve, and received there. */
enum kind { TEXELS, OWN_SAMPLES, HALF_SAMPLES, KINDS };

struct records {
    size_t size, count, capacity; /* size: of one, bytes */
    unsigned char *at;
};

struct kiln_joined {
    MPI_Comm communicator;
    const struct kiln_joints *joints;
    const struct kiln_assignment *assignment;
    const struct kiln_map_planes *planes;
    uint32_t plane_count;        /* those that are smoothed */
    size_t *first;               /* of each lightmap in `joints_of`, and the end */
    uint32_t *joints_of;         /* numbers of joints */
    struct records kinds[KINDS]; /* of own maps; then of the groups that this rank solves */
    struct records solution;     /* texels of own maps, by map and texel */
};

static void *record_at(const struct records *records, size_t i) { return records->at + i * records->size; }

static void drop_records(struct records *records)
{
    kiln_free(&records->at);
    records->count = records->capacity = 0;
}

/* Lists the joints of each lightmap. */
static int index_joints(struct kiln_joined *j, struct kiln_error *error)
{
    const struct kiln_joints *joints = j->joints;
    int status = kiln_allocate(&j->first, joints->map_count + 1, sizeof *j->first, "joints of objects", error);
    if (status == KILN_OK)
        status = kiln_allocate(&j->joints_of, 2 * joints->count, sizeof *j->joints_of, "joints of objects", error);
    if (status != KILN_OK)
        return status;
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

int kiln_joined_create(struct kiln_joined **joined, MPI_Comm communicator, const struct kiln_joints *joints,
                       const struct kiln_assignment *assignment, const struct kiln_map_planes *planes,
                       struct kiln_error *error)
{
    int status = kiln_allocate(joined, 1, sizeof **joined, "joined seams", error);
    if (status != KILN_OK)
        return status;
    struct kiln_joined *j = *joined;
    j->communicator = communicator;
    j->joints = joints;
    j->assignment = assignment;
    j->planes = planes;
    j->plane_count = kiln_map_smooth_planes(planes);
    j->kinds[TEXELS].size = j->solution.size = sizeof(struct texel) + j->plane_count * sizeof(float);
    j->kinds[OWN_SAMPLES].size = sizeof(struct own_sample);
    j->kinds[HALF_SAMPLES].size = sizeof(struct half_sample);
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
    kiln_free(&j->first);
    kiln_free(&j->joints_of);
    kiln_free(joined);
}

/* ---- what a map adds ---- */

/* A map with the samples that read it. */
struct part {
    uint32_t number;
    const struct kiln_map *map;
    struct kiln_seam_sample *own;
    struct half_sample *halves;
    size_t own_count, half_count, half_capacity, texel_count;
    uint32_t *marks, *texels;
};

static int add_halves(const struct kiln_joined *j, struct part *p, uint32_t joint, const uint32_t *nearest,
                      struct kiln_error *error)
{
    const struct kiln_joint *at = &j->joints->joints[joint];
    const uint32_t side = at->map[0] == p->number ? 0 : 1;
    const size_t count = kiln_seam_sample_count(&at->edge);
    const int status =
        kiln_grow(&p->halves, &p->half_capacity, p->half_count + count, sizeof *p->halves, "seam samples", error);
    const float *from = at->edge.texel[side][0], *to = at->edge.texel[side][1];
    for (size_t i = 0; status == KILN_OK && i < count; i++) {
        const float t = kiln_seam_sample_place(i, count);
        struct half_sample *half = &p->halves[p->half_count];
        *half = (struct half_sample){.joint = joint, .index = (uint32_t)i, .side = side};
        p->half_count +=
            kiln_seam_footprint(p->map, nearest, from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1]),
                                side == 0 ? 1.0f : -1.0f, half->at, half->weight);
    }
    return status;
}

/* The texels that the samples read. */
static int list_texels(struct part *p, struct kiln_error *error)
{
    const int status = kiln_allocate(&p->marks, kiln_map_texels(p->map), sizeof *p->marks, "a seam's texels", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < p->own_count; i++)
        for (int k = 0; k < ENTRIES; k++)
            p->marks[p->own[i].at[k]] = 1;
    for (size_t i = 0; i < p->half_count; i++)
        for (int k = 0; k < SIDE; k++)
            p->marks[p->halves[i].at[k]] = 1;
    return kiln_seams_number(p->map, p->marks, &p->texels, &p->texel_count, error);
}

static void copy_texel(const struct kiln_joined *j, const struct part *p, uint32_t at, struct texel *texel)
{
    *texel = (struct texel){.map = p->number, .at = at, .area = p->map->area[at]};
    for (uint32_t plane = 0, to = 0; plane < j->planes->count; plane++)
        if (j->planes->smooth[plane])
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
        status = make_room(&kinds[OWN_SAMPLES], p->own_count, error);
    if (status == KILN_OK)
        status = make_room(&kinds[HALF_SAMPLES], p->half_count, error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < p->texel_count; i++)
        copy_texel(j, p, p->texels[i], record_at(&kinds[TEXELS], kinds[TEXELS].count++));
    for (size_t i = 0; i < p->own_count; i++)
        *(struct own_sample *)record_at(&kinds[OWN_SAMPLES], kinds[OWN_SAMPLES].count++) =
            (struct own_sample){p->number, (uint32_t)i, p->own[i]};
    for (size_t i = 0; i < p->half_count; i++)
        *(struct half_sample *)record_at(&kinds[HALF_SAMPLES], kinds[HALF_SAMPLES].count++) = p->halves[i];
    return KILN_OK;
}

int kiln_joined_add(struct kiln_joined *j, uint32_t number, struct kiln_map *map, const struct kiln_chart_graph *graph,
                    const uint32_t *nearest, struct kiln_error *error)
{
    struct part part = {.number = number, .map = map};
    (void)kiln_map_dilate(map, nearest);
    int status = kiln_seams_sample(map, graph, nearest, &part.own, &part.own_count, error);
    for (size_t i = j->first[number]; status == KILN_OK && i < j->first[number + 1]; i++)
        status = add_halves(j, &part, j->joints_of[i], nearest, error);
    if (status == KILN_OK)
        status = list_texels(&part, error);
    if (status == KILN_OK) {
#pragma omp critical(kiln_joined_add)
        status = hand_over(j, &part, error);
    }
    kiln_free(&part.own);
    kiln_free(&part.halves);
    kiln_free(&part.marks);
    kiln_free(&part.texels);
    return status;
}

/* ---- messages ---- */

/* The lightmap that a record belongs to. */
static uint32_t map_of(const struct kiln_joined *j, enum kind kind, const void *record)
{
    if (kind == TEXELS)
        return ((const struct texel *)record)->map;
    if (kind == OWN_SAMPLES)
        return ((const struct own_sample *)record)->map;
    const struct half_sample *half = record;
    return j->joints->joints[half->joint].map[half->side];
}

/* The rank that solves the lightmap's group. */
static int solver_of(const struct kiln_joined *j, uint32_t map)
{
    return (int)j->assignment->owner[j->joints->group[map]];
}

/* The counts and places of messages to or from each rank. */
struct travel {
    int ranks, *out_counts, *out_starts, *in_counts, *in_starts, *targets; /* targets: of each record */
    unsigned char *sorted;
    MPI_Datatype type;
};

/* Sorts records by the rank that they go to, in their order. */
static int sort_out(struct travel *t, const struct records *records, struct kiln_error *error)
{
    int status = records->count < INT_MAX
                     ? KILN_OK
                     : kiln_fail(error, KILN_SYSTEM,
                                 "%zu texels of this rank lie at seams of objects that touch, too many for one "
                                 "message; use more ranks or --no-stitch",
                                 records->count);
    if (status == KILN_OK)
        status = kiln_allocate(&t->sorted, records->count, records->size, "joined seams", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < records->count; i++)
        t->out_counts[t->targets[i]]++;
    for (int r = 1; r < t->ranks; r++)
        t->out_starts[r] = t->out_starts[r - 1] + t->out_counts[r - 1];
    for (size_t i = 0; i < records->count; i++) {
        const int to = t->out_starts[t->targets[i]]++;
        memcpy(t->sorted + (size_t)to * records->size, record_at(records, i), records->size);
    }
    for (int r = 0; r < t->ranks; r++)
        t->out_starts[r] -= t->out_counts[r];
    return KILN_OK;
}

static int begin_travel(struct travel *t, const struct kiln_joined *j, size_t count, size_t size,
                        struct kiln_error *error)
{
    int **arrays[] = {&t->out_counts, &t->out_starts, &t->in_counts, &t->in_starts};
    t->type = MPI_DATATYPE_NULL;
    if (MPI_Comm_size(j->communicator, &t->ranks) != MPI_SUCCESS ||
        MPI_Type_contiguous((int)size, MPI_BYTE, &t->type) != MPI_SUCCESS || MPI_Type_commit(&t->type) != MPI_SUCCESS)
        return kiln_fail(error, KILN_SITE, "MPI refused a datatype of %zu bytes", size);
    int status = kiln_allocate(&t->targets, count, sizeof *t->targets, "joined seams", error);
    for (size_t i = 0; status == KILN_OK && i < sizeof arrays / sizeof *arrays; i++)
        status = kiln_allocate(arrays[i], (size_t)t->ranks, sizeof(int), "joined seams", error);
    return status;
}

static void end_travel(struct travel *t)
{
    if (t->type != MPI_DATATYPE_NULL)
        (void)MPI_Type_free(&t->type);
    kiln_free(&t->out_counts);
    kiln_free(&t->out_starts);
    kiln_free(&t->in_counts);
    kiln_free(&t->in_starts);
    kiln_free(&t->targets);
    kiln_free(&t->sorted);
}

/* Makes room for what comes. */
static int expect(struct travel *t, struct records *records, struct kiln_error *error)
{
    size_t total = 0;
    for (int r = 0; r < t->ranks; r++) {
        t->in_starts[r] = (int)total;
        total += (size_t)t->in_counts[r];
        if (total > INT_MAX)
            return kiln_fail(error, KILN_SYSTEM,
                             "too many texels at seams of objects that touch come to one rank; use --no-stitch");
    }
    drop_records(records);
    const int status = make_room(records, total, error);
    records->count = status == KILN_OK ? total : 0;
    return status;
}

/* Collective. Sends each record to its target, and replaces the records by those that come. The targets have been
 * set if `status` is KILN_OK. */
static int send_records(struct kiln_joined *j, struct travel *t, struct records *records, int status,
                        struct kiln_error *error)
{
    if (status == KILN_OK)
        status = sort_out(t, records, error);
    if ((status = kiln_agree(j->communicator, status, error)) != KILN_OK)
        return status;
    if (MPI_Alltoall(t->out_counts, 1, MPI_INT, t->in_counts, 1, MPI_INT, j->communicator) != MPI_SUCCESS)
        return kiln_fail(error, KILN_RANK_LOST, "MPI failed in MPI_Alltoall while seams of objects were joined");
    if ((status = kiln_agree(j->communicator, expect(t, records, error), error)) != KILN_OK)
        return status;
    if (MPI_Alltoallv(t->sorted, t->out_counts, t->out_starts, t->type, records->at, t->in_counts, t->in_starts,
                      t->type, j->communicator) != MPI_SUCCESS)
        return kiln_fail(error, KILN_RANK_LOST, "MPI failed in MPI_Alltoallv while seams of objects were joined");
    return KILN_OK;
}

/* Collective. Sends records to the ranks that solve their groups, or with `home` to the owners of their lightmaps. */
static int travel(struct kiln_joined *j, enum kind kind, struct records *records, bool home, struct kiln_error *error)
{
    struct travel t = {0};
    int status = begin_travel(&t, j, records->count, records->size, error);
    for (size_t i = 0; status == KILN_OK && i < records->count; i++) {
        const uint32_t map = map_of(j, kind, record_at(records, i));
        t.targets[i] = home ? (int)j->assignment->owner[map] : solver_of(j, map);
    }
    status = send_records(j, &t, records, status, error);
    end_travel(&t);
    return status;
}

/* ---- order ---- */

static int order_of(uint64_t a, uint64_t b) { return (a > b) - (a < b); }

static int order_groups(const struct kiln_joined *j, enum kind kind, const void *a, const void *b)
{
    return order_of(j->joints->group[map_of(j, kind, a)], j->joints->group[map_of(j, kind, b)]);
}

static int compare_texels(const void *a, const void *b, void *context)
{
    const struct texel *p = a, *q = b;
    const int groups = order_groups(context, TEXELS, a, b), maps = order_of(p->map, q->map);
    return groups != 0 ? groups : maps != 0 ? maps : order_of(p->at, q->at);
}

static int compare_own(const void *a, const void *b, void *context)
{
    const struct own_sample *p = a, *q = b;
    const int groups = order_groups(context, OWN_SAMPLES, a, b), maps = order_of(p->map, q->map);
    return groups != 0 ? groups : maps != 0 ? maps : order_of(p->index, q->index);
}

static int compare_halves(const void *a, const void *b, void *context)
{
    const struct half_sample *p = a, *q = b;
    const int groups = order_groups(context, HALF_SAMPLES, a, b), joints = order_of(p->joint, q->joint);
    const int places = order_of(p->index, q->index);
    return groups != 0 ? groups : joints != 0 ? joints : places != 0 ? places : order_of(p->side, q->side);
}

static void sort_records(struct kiln_joined *j, const struct records *records,
                         int (*compare)(const void *, const void *, void *))
{
    if (records->count > 1)
        qsort_r(records->at, records->count, records->size, compare, j);
}

/* ---- solving ---- */

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
               j->joints->group[map_of(j, (enum kind)k, record_at(records, g->end[k]))] == g->number)
            g->end[k]++;
    }
}

static struct texel *texel_at(const struct kiln_joined *j, const struct group *g, size_t i)
{
    return record_at(&j->kinds[TEXELS], g->first[TEXELS] + i);
}

/* The number of a texel in its group; KILN_NONE if it is not there. */
static uint32_t number_of(const struct kiln_joined *j, const struct group *g, uint32_t map, uint32_t at)
{
    size_t low = 0, high = g->end[TEXELS] - g->first[TEXELS];
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        const struct texel *texel = texel_at(j, g, middle);
        if (texel->map < map || (texel->map == map && texel->at < at))
            low = middle + 1;
        else
            high = middle;
    }
    if (low == g->end[TEXELS] - g->first[TEXELS])
        return KILN_NONE;
    const struct texel *texel = texel_at(j, g, low);
    return texel->map == map && texel->at == at ? (uint32_t)low : KILN_NONE;
}

/* Replaces texels of `map` by numbers in `count` entries. False if one is missing. */
static bool number_entries(const struct kiln_joined *j, const struct group *g, uint32_t map, uint32_t *at, int count)
{
    for (int k = 0; k < count; k++) {
        at[k] = number_of(j, g, map, at[k]);
        if (at[k] == KILN_NONE)
            return false;
    }
    return true;
}

static bool add_own_samples(const struct kiln_joined *j, const struct group *g, struct kiln_seam_system *s)
{
    bool good = true;
    for (size_t i = g->first[OWN_SAMPLES]; i < g->end[OWN_SAMPLES]; i++) {
        const struct own_sample *own = record_at(&j->kinds[OWN_SAMPLES], i);
        struct kiln_seam_sample *sample = &s->samples[s->sample_count++];
        *sample = own->sample;
        good = number_entries(j, g, own->map, sample->at, ENTRIES) && good;
    }
    return good;
}

/* Both sides of a sample follow one another, unless one map has no surface there. */
static bool add_joint_samples(const struct kiln_joined *j, const struct group *g, struct kiln_seam_system *s)
{
    bool good = true;
    for (size_t i = g->first[HALF_SAMPLES]; i + 1 < g->end[HALF_SAMPLES]; i++) {
        const struct half_sample *half = record_at(&j->kinds[HALF_SAMPLES], i), *other = half + 1;
        if (half->joint != other->joint || half->index != other->index)
            continue;
        struct kiln_seam_sample sample;
        memcpy(sample.at, half->at, sizeof half->at);
        memcpy(sample.at + SIDE, other->at, sizeof other->at);
        memcpy(sample.weight, half->weight, sizeof half->weight);
        memcpy(sample.weight + SIDE, other->weight, sizeof other->weight);
        const uint32_t *maps = j->joints->joints[half->joint].map;
        good = number_entries(j, g, maps[0], sample.at, SIDE) &&
               number_entries(j, g, maps[1], sample.at + SIDE, SIDE) && good;
        if (good && !kiln_seam_edge_of_light(s->planes, &sample))
            s->samples[s->sample_count++] = sample;
        i++;
    }
    return good;
}

static void copy_values(const struct kiln_joined *j, const struct group *g, struct kiln_seam_system *s, bool back)
{
    for (size_t i = 0; i < s->unknown_count; i++) {
        struct texel *texel = texel_at(j, g, i);
        s->area[i] = texel->area;
        for (uint32_t p = 0; p < s->plane_count; p++)
            if (back)
                texel->values[p] = s->planes[p][i];
            else
                s->planes[p][i] = texel->values[p];
    }
}

static int solve_group(const struct kiln_joined *j, const struct group *g, struct kiln_error *error)
{
    struct kiln_seam_system *system = NULL;
    const size_t unknowns = g->end[TEXELS] - g->first[TEXELS], own = g->end[OWN_SAMPLES] - g->first[OWN_SAMPLES],
                 halves = g->end[HALF_SAMPLES] - g->first[HALF_SAMPLES];
    int status = kiln_seam_system_create(&system, unknowns, own + halves / 2, j->plane_count, error);
    if (status == KILN_OK) {
        copy_values(j, g, system, false);
        system->sample_count = 0;
        if (!add_own_samples(j, g, system) || !add_joint_samples(j, g, system))
            status =
                kiln_fail(error, KILN_BUG, "a texel at a seam of the group of lightmap %u did not arrive", g->number);
    }
    if (status == KILN_OK)
        status = kiln_seam_system_solve(system, error);
    if (status == KILN_OK)
        copy_values(j, g, system, true);
    kiln_seam_system_destroy(&system);
    return status;
}

static int solve_groups(struct kiln_joined *j, struct kiln_error *error)
{
    struct group group = {0};
    int status = KILN_OK;
    sort_records(j, &j->kinds[TEXELS], compare_texels);
    sort_records(j, &j->kinds[OWN_SAMPLES], compare_own);
    sort_records(j, &j->kinds[HALF_SAMPLES], compare_halves);
    while (status == KILN_OK && group.first[TEXELS] < j->kinds[TEXELS].count) {
        group.number = j->joints->group[texel_at(j, &group, 0)->map];
        find_end(j, &group);
        status = solve_group(j, &group, error);
        memcpy(group.first, group.end, sizeof group.first);
    }
    return status;
}

int kiln_joined_solve(struct kiln_joined *j, struct kiln_error *error)
{
    int status = KILN_OK;
    for (int k = 0; status == KILN_OK && k < KINDS; k++)
        status = travel(j, (enum kind)k, &j->kinds[k], false, error);
    if (status == KILN_OK)
        status = kiln_agree(j->communicator, solve_groups(j, error), error);
    if (status != KILN_OK)
        return status;
    drop_records(&j->kinds[OWN_SAMPLES]);
    drop_records(&j->kinds[HALF_SAMPLES]);
    drop_records(&j->solution);
    j->solution = j->kinds[TEXELS];
    j->kinds[TEXELS] = (struct records){.size = j->solution.size};
    status = travel(j, TEXELS, &j->solution, true, error);
    if (status == KILN_OK)
        sort_records(j, &j->solution, compare_texels);
    return status;
}

/* Whether the texel's lightmap stands before another in the order of the solution. */
static bool is_before(const struct kiln_joined *j, const struct texel *texel, uint32_t number)
{
    const int groups = order_of(j->joints->group[texel->map], j->joints->group[number]);
    return groups < 0 || (groups == 0 && texel->map < number);
}

void kiln_joined_apply(const struct kiln_joined *j, uint32_t number, struct kiln_map *map, uint32_t *nearest)
{
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
        for (uint32_t plane = 0, from = 0; plane < j->planes->count; plane++)
            if (j->planes->smooth[plane])
                kiln_seam_set(map, nearest, plane, texel->at, texel->values[from++]);
    }
}
