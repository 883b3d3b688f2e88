#include "coordinator/output/map/denoise_parts.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/output/map/bands.h"
#include "worker/base/memory.h"

/* Side of the smallest cubes, in the smallest texels that are in it, as of the cells of neighbours.c, which lie in one
 * cube each; and points of a lightmap from which on cubes are larger. */
enum { SIDE = 8, MANY = 1 << 24, FARTHEST = 1 << 30 };

/* How far what is done in a sweep of the regression looks, the last one first, in texels. */
static const float hops[] = {KILN_NEIGHBOUR_RADIUS, 6.0f, 6.0f, KILN_NEIGHBOUR_RADIUS};
enum { HOPS = sizeof hops / sizeof *hops };

/* A cube in which there are points whose texels are of 2^level to 2^(level + 1) m. */
struct cube {
    int32_t level, at[3];
    float low[3], high[3]; /* the box around them */
    float size;            /* the side of the largest texel, m */
    uint32_t part;
    uint64_t count;
};

struct cubes {
    struct cube *cubes;
    size_t count, capacity;
};

/* A point on its way. */
struct record {
    float position[3], normal[3], area, size;
    uint64_t key;
    uint32_t own, unused; /* own: it belongs to the part */
    float values[];
};

struct kiln_parts_way {
    int shift;              /* cubes have a side of SIDE << shift texels */
    struct cubes here, all; /* of own points, and of all ranks'; by place, none twice */
    uint32_t *cube_of;      /* of each own point, in `here` */
    uint8_t *far;           /* of each of `all`: KILN_PARTS_FAR if this rank does not see it */
    uint32_t *seen;         /* numbers of those of `all` that this rank sees, its own first */
    size_t seen_count;
    size_t *first;      /* of each of `here` in `needed`, and the end */
    uint32_t *needed;   /* parts that need its points; first the one that has them */
    uint32_t *sent_own; /* points that were sent to be own, by part */
    unsigned char *out, *in;
    int *out_counts, *out_starts, *in_counts, *in_starts;
    int *own_out, *own_out_starts, *own_in, *own_in_starts; /* of these, own ones */
};

static int mpi_failed(struct kiln_error *error)
{
    return kiln_fail(error, KILN_RANK_LOST, "MPI failed while points of a lightmap were divided for denoising");
}

/* ---- cubes ---- */

static int compare_cubes(const void *a, const void *b)
{
    const struct cube *p = a, *q = b;
    if (p->level != q->level)
        return p->level < q->level ? -1 : 1;
    for (int c = 0; c < 3; c++)
        if (p->at[c] != q->at[c])
            return p->at[c] < q->at[c] ? -1 : 1;
    return 0;
}

static void join_cubes(struct cube *to, const struct cube *from)
{
    for (int c = 0; c < 3; c++) {
        to->low[c] = fminf(to->low[c], from->low[c]);
        to->high[c] = fmaxf(to->high[c], from->high[c]);
    }
    to->size = fmaxf(to->size, from->size);
    to->count += from->count;
}

/* Sorts, and makes one of those that are in the same place. */
static void sort_cubes(struct cubes *cubes)
{
    size_t kept = 0;
    if (cubes->count > 1)
        qsort(cubes->cubes, cubes->count, sizeof *cubes->cubes, compare_cubes);
    for (size_t i = 0; i < cubes->count; i++)
        if (kept > 0 && compare_cubes(&cubes->cubes[kept - 1], &cubes->cubes[i]) == 0)
            join_cubes(&cubes->cubes[kept - 1], &cubes->cubes[i]);
        else
            cubes->cubes[kept++] = cubes->cubes[i];
    cubes->count = kept;
}

/* The first cube that is not before `key`. */
static size_t find_cube(const struct cubes *cubes, const struct cube *key)
{
    size_t low = 0, high = cubes->count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (compare_cubes(&cubes->cubes[middle], key) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static int32_t cube_along(float position, int level, int shift)
{
    const double at = floor(ldexp((double)position / SIDE, -level - shift));
    return (int32_t)fmin(fmax(at, -(double)FARTHEST), (double)FARTHEST);
}

static struct cube cube_around(const float position[3], float size, int shift)
{
    struct cube cube = {.size = size, .count = 1};
    (void)frexpf(size, &cube.level);
    cube.level--;
    for (int c = 0; c < 3; c++) {
        cube.at[c] = cube_along(position[c], cube.level, shift);
        cube.low[c] = cube.high[c] = position[c];
    }
    return cube;
}

/* Lists the cubes of own points. Points that follow one another often share one. */
static int list_here(struct kiln_parts_way *w, const struct kiln_parts_given *given, struct kiln_error *error)
{
    struct cubes *here = &w->here;
    int status = KILN_OK;
    for (size_t i = 0; i < given->count && status == KILN_OK; i++) {
        const struct cube cube = cube_around(given->points[i].position, given->points[i].size, w->shift);
        if (here->count > 0 && compare_cubes(&here->cubes[here->count - 1], &cube) == 0) {
            join_cubes(&here->cubes[here->count - 1], &cube);
            continue;
        }
        status = kiln_grow(&here->cubes, &here->capacity, here->count + 1, sizeof cube, "parts of a lightmap", error);
        if (status == KILN_OK)
            here->cubes[here->count++] = cube;
    }
    sort_cubes(here);
    for (size_t i = 0, last = 0; i < given->count && status == KILN_OK; i++) {
        const struct cube cube = cube_around(given->points[i].position, given->points[i].size, w->shift);
        if (i == 0 || compare_cubes(&here->cubes[last], &cube) != 0)
            last = find_cube(here, &cube);
        w->cube_of[i] = (uint32_t)last;
    }
    return status;
}

/* How many records each rank has, and where they begin. Returns their number; SIZE_MAX: too many for a message. */
static size_t begin_all(const int *counts, int *starts, uint32_t ranks)
{
    size_t total = 0;
    for (uint32_t r = 0; r < ranks; r++) {
        starts[r] = (int)total;
        total += (size_t)counts[r];
        if (counts[r] < 0 || total > INT_MAX)
            return SIZE_MAX;
    }
    return total;
}

static int make_type(MPI_Datatype *type, size_t size, struct kiln_error *error)
{
    if (MPI_Type_contiguous((int)size, MPI_BYTE, type) != MPI_SUCCESS || MPI_Type_commit(type) != MPI_SUCCESS)
        return kiln_fail(error, KILN_SITE, "MPI refused a datatype of %zu bytes", size);
    return KILN_OK;
}

static int too_many(struct kiln_error *error)
{
    return kiln_fail(error, KILN_SYSTEM,
                     "too many points of one lightmap come to one rank; use more ranks, or "
                     "--denoise none");
}

/* Collective. All ranks learn of all cubes. */
static int share_cubes(struct kiln_parts_way *w, const struct kiln_bands *bands, struct kiln_error *error)
{
    const int mine = w->here.count < INT_MAX ? (int)w->here.count : -1;
    MPI_Datatype type = MPI_DATATYPE_NULL;
    size_t total = 0;
    if (MPI_Allgather(&mine, 1, MPI_INT, w->in_counts, 1, MPI_INT, bands->comm) != MPI_SUCCESS)
        return mpi_failed(error);
    int status = (total = begin_all(w->in_counts, w->in_starts, bands->ranks)) == SIZE_MAX ? too_many(error) : KILN_OK;
    if (status == KILN_OK)
        status = kiln_grow(&w->all.cubes, &w->all.capacity, total, sizeof(struct cube), "parts of a lightmap", error);
    if (status == KILN_OK)
        status = make_type(&type, sizeof(struct cube), error);
    if ((status = kiln_agree(bands->comm, status, error)) == KILN_OK &&
        MPI_Allgatherv(w->here.cubes, mine, type, w->all.cubes, w->in_counts, w->in_starts, type, bands->comm) !=
            MPI_SUCCESS)
        status = mpi_failed(error);
    if (type != MPI_DATATYPE_NULL)
        (void)MPI_Type_free(&type);
    w->all.count = status == KILN_OK ? total : 0;
    sort_cubes(&w->all);
    return status;
}

/* ---- parts ---- */

static int compare_along(const void *a, const void *b, void *context)
{
    const int axis = *(const int *)context;
    const struct cube *p = a, *q = b;
    const float middle = p->low[axis] + p->high[axis], other = q->low[axis] + q->high[axis];
    return middle != other ? (middle < other ? -1 : 1) : compare_cubes(a, b);
}

static int longest_axis(const struct cube *cubes, size_t count)
{
    struct cube all = cubes[0];
    int axis = 0;
    for (size_t i = 1; i < count; i++)
        join_cubes(&all, &cubes[i]);
    for (int c = 1; c < 3; c++)
        axis = all.high[c] - all.low[c] > all.high[axis] - all.low[axis] ? c : axis;
    return axis;
}

/* Shares cubes out to the parts [first, first + parts). */
static void cut(struct cube *cubes, size_t count, uint32_t first, uint32_t parts)
{
    if (parts == 1 || count == 0) {
        for (size_t i = 0; i < count; i++)
            cubes[i].part = first;
        return;
    }
    int axis = longest_axis(cubes, count);
    const uint32_t half = parts / 2;
    uint64_t total = 0, before = 0;
    size_t at = 0;
    qsort_r(cubes, count, sizeof *cubes, compare_along, &axis);
    for (size_t i = 0; i < count; i++)
        total += cubes[i].count;
    /* as many before the cut as is nearest to their share */
    while (at < count && (2 * before + cubes[at].count) * parts < 2 * total * half)
        before += cubes[at++].count;
    cut(cubes, at, first, half);
    cut(cubes + at, count - at, first + half, parts - half);
}

/* ---- what a part sees ---- */

static bool is_near(const struct cube *a, const struct cube *b, float reach)
{
    for (int c = 0; c < 3; c++)
        if (b->low[c] > a->high[c] + reach || b->high[c] < a->low[c] - reach)
            return false;
    return true;
}

/* Adds the cubes of one level near a cube that are not yet seen. */
static void see_level(struct kiln_parts_way *w, const struct cube *from, int level, float reach, uint8_t far)
{
    struct cube key = {.level = level, .at = {-FARTHEST, -FARTHEST, -FARTHEST}};
    int32_t low[3], high[3];
    const size_t begin = find_cube(&w->all, &key);
    if (begin == w->all.count || w->all.cubes[begin].level != level)
        return;
    for (int c = 0; c < 3; c++) {
        low[c] = cube_along(from->low[c] - reach, level, w->shift);
        high[c] = cube_along(from->high[c] + reach, level, w->shift);
    }
    for (key.at[0] = low[0]; key.at[0] <= high[0]; key.at[0]++)
        for (key.at[1] = low[1]; key.at[1] <= high[1]; key.at[1]++) {
            key.at[2] = low[2];
            for (size_t i = find_cube(&w->all, &key); i < w->all.count; i++) {
                const struct cube *cube = &w->all.cubes[i];
                if (cube->level != level || cube->at[0] != key.at[0] || cube->at[1] != key.at[1] ||
                    cube->at[2] > high[2])
                    break;
                if (w->far[i] == KILN_PARTS_FAR && is_near(from, cube, reach)) {
                    w->far[i] = far;
                    w->seen[w->seen_count++] = (uint32_t)i;
                }
            }
        }
}

/* Lists the cubes that this rank sees, hop by hop: what becomes of a point is told by points that are near in the last
 * sweep, what is known of these by points near them in the sweep before, and so on. Neighbours' texels are less than
 * four times as large or small: of the level above or below at most. */
static int see(struct kiln_parts_way *w, uint32_t part, struct kiln_error *error)
{
    int status = kiln_allocate_bare(&w->far, w->all.count, sizeof *w->far, "parts of a lightmap", error);
    if (status == KILN_OK)
        status = kiln_allocate_bare(&w->seen, w->all.count, sizeof *w->seen, "parts of a lightmap", error);
    for (size_t i = 0; i < w->all.count && status == KILN_OK; i++) {
        w->far[i] = w->all.cubes[i].part == part ? 0 : KILN_PARTS_FAR;
        if (w->far[i] == 0)
            w->seen[w->seen_count++] = (uint32_t)i;
    }
    for (uint8_t hop = 0; hop < HOPS && status == KILN_OK; hop++)
        for (size_t i = 0, end = w->seen_count; i < end; i++) {
            const struct cube *from = &w->all.cubes[w->seen[i]];
            const float reach = 1.001f * hops[hop] * from->size; /* some more, for the rounding of distances */
            for (int level = from->level - 1; level <= from->level + 1; level++)
                see_level(w, from, level, reach, (uint8_t)(hop + 1));
        }
    return status;
}

/* Collective. Gathers what all ranks see, one after the other. */
static int share_seen(struct kiln_parts_way *w, const struct kiln_bands *bands, uint32_t **seen,
                      struct kiln_error *error)
{
    const int mine = w->seen_count < INT_MAX ? (int)w->seen_count : -1;
    size_t total = 0;
    if (MPI_Allgather(&mine, 1, MPI_INT, w->in_counts, 1, MPI_INT, bands->comm) != MPI_SUCCESS)
        return mpi_failed(error);
    int status = (total = begin_all(w->in_counts, w->in_starts, bands->ranks)) == SIZE_MAX ? too_many(error) : KILN_OK;
    if (status == KILN_OK)
        status = kiln_allocate_bare(seen, total, sizeof **seen, "parts of a lightmap", error);
    if ((status = kiln_agree(bands->comm, status, error)) == KILN_OK &&
        MPI_Allgatherv(w->seen, mine, MPI_UINT32_T, *seen, w->in_counts, w->in_starts, MPI_UINT32_T, bands->comm) !=
            MPI_SUCCESS)
        status = mpi_failed(error);
    return status;
}

/* Calls `visit` for each part that sees a cube in which this rank has points: first the part that has it. */
static void visit_needed(struct kiln_parts_way *w, const uint32_t *seen, uint32_t ranks,
                         void (*visit)(struct kiln_parts_way *, size_t here, uint32_t part))
{
    for (int others = 0; others < 2; others++)
        for (uint32_t part = 0; part < ranks; part++)
            for (int i = 0; i < w->in_counts[part]; i++) {
                const struct cube *cube = &w->all.cubes[seen[w->in_starts[part] + i]];
                const size_t here = find_cube(&w->here, cube);
                if ((cube->part != part) == (others == 1) && here < w->here.count &&
                    compare_cubes(&w->here.cubes[here], cube) == 0)
                    visit(w, here, part);
            }
}

static void count_needed(struct kiln_parts_way *w, size_t here, uint32_t part)
{
    (void)part;
    w->first[here + 1]++;
}

static void list_needed(struct kiln_parts_way *w, size_t here, uint32_t part) { w->needed[w->first[here]++] = part; }

/* Collective. Lists the parts that need the points of each own cube. */
static int find_needed(struct kiln_parts_way *w, const struct kiln_bands *bands, struct kiln_error *error)
{
    const size_t count = w->here.count;
    uint32_t *seen = NULL;
    int status = kiln_allocate(&w->first, count + 1, sizeof *w->first, "parts of a lightmap", error);
    if (status == KILN_OK)
        status = see(w, bands->rank, error);
    if ((status = kiln_agree(bands->comm, status, error)) == KILN_OK)
        status = share_seen(w, bands, &seen, error);
    if (status == KILN_OK)
        visit_needed(w, seen, bands->ranks, count_needed);
    for (size_t i = 0; i < count; i++)
        w->first[i + 1] += w->first[i];
    if (status == KILN_OK)
        status = kiln_allocate_bare(&w->needed, w->first[count], sizeof *w->needed, "parts of a lightmap", error);
    if (status == KILN_OK) {
        visit_needed(w, seen, bands->ranks, list_needed);
        memmove(w->first + 1, w->first, count * sizeof *w->first);
        w->first[0] = 0;
    }
    kiln_free(&seen);
    return kiln_agree(bands->comm, status, error);
}

/* ---- to the parts ---- */

static size_t record_size(size_t planes)
{
    const size_t size = sizeof(struct record) + planes * sizeof(float);
    return (size + _Alignof(struct record) - 1) / _Alignof(struct record) * _Alignof(struct record);
}

/* How many records go to each rank, and how many of them are own there. */
static int count_records(struct kiln_parts_way *w, const struct kiln_parts_given *given, uint32_t ranks,
                         struct kiln_error *error)
{
    memset(w->out_counts, 0, ranks * sizeof *w->out_counts);
    for (size_t i = 0; i < given->count; i++)
        for (size_t k = w->first[w->cube_of[i]]; k < w->first[w->cube_of[i] + 1]; k++) {
            w->out_counts[w->needed[k]]++;
            w->own_out[w->needed[k]] += k == w->first[w->cube_of[i]];
        }
    (void)begin_all(w->own_out, w->own_out_starts, ranks);
    return begin_all(w->out_counts, w->out_starts, ranks) == SIZE_MAX ? too_many(error) : KILN_OK;
}

static void fill_record(struct record *record, const struct kiln_parts_given *given, size_t i, bool own)
{
    const struct kiln_neighbour_point *p = &given->points[i];
    *record = (struct record){.area = p->area, .size = p->size, .key = given->keys[i], .own = own};
    memcpy(record->position, p->position, sizeof record->position);
    memcpy(record->normal, p->normal, sizeof record->normal);
    for (size_t plane = 0; plane < given->planes; plane++)
        record->values[plane] = given->values[plane][p->index];
}

/* Lays records down by rank, in the order of points. */
static void pack_records(struct kiln_parts_way *w, const struct kiln_parts_given *given, uint32_t ranks)
{
    const size_t size = record_size(given->planes);
    for (size_t i = 0; i < given->count; i++)
        for (size_t k = w->first[w->cube_of[i]]; k < w->first[w->cube_of[i] + 1]; k++) {
            const uint32_t part = w->needed[k];
            const bool own = k == w->first[w->cube_of[i]];
            fill_record((void *)(w->out + (size_t)w->out_starts[part]++ * size), given, i, own);
            if (own)
                w->sent_own[w->own_out_starts[part]++] = (uint32_t)i;
        }
    (void)begin_all(w->out_counts, w->out_starts, ranks);
    (void)begin_all(w->own_out, w->own_out_starts, ranks);
}

/* Collective. Sends all records. *total: those that come. */
static int send_records(struct kiln_parts_way *w, const struct kiln_parts_given *given, size_t *total,
                        struct kiln_error *error)
{
    const struct kiln_bands *bands = given->map->bands;
    const size_t size = record_size(given->planes);
    MPI_Datatype type = MPI_DATATYPE_NULL;
    int status = count_records(w, given, bands->ranks, error);
    if (status == KILN_OK)
        status = kiln_allocate_bare(&w->sent_own, given->count, sizeof *w->sent_own, "parts of a lightmap", error);
    if (status == KILN_OK)
        status =
            kiln_allocate_bare(&w->out, (size_t)(w->out_starts[bands->ranks - 1] + w->out_counts[bands->ranks - 1]),
                               size, "parts of a lightmap", error);
    if (status == KILN_OK)
        status = make_type(&type, size, error);
    if ((status = kiln_agree(bands->comm, status, error)) == KILN_OK) {
        pack_records(w, given, bands->ranks);
        if (MPI_Alltoall(w->out_counts, 1, MPI_INT, w->in_counts, 1, MPI_INT, bands->comm) != MPI_SUCCESS ||
            MPI_Alltoall(w->own_out, 1, MPI_INT, w->own_in, 1, MPI_INT, bands->comm) != MPI_SUCCESS)
            status = mpi_failed(error);
    }
    if (status == KILN_OK && (*total = begin_all(w->in_counts, w->in_starts, bands->ranks)) == SIZE_MAX)
        status = too_many(error);
    (void)begin_all(w->own_in, w->own_in_starts, bands->ranks);
    if (status == KILN_OK)
        status = kiln_allocate_bare(&w->in, *total, size, "parts of a lightmap", error);
    if ((status = kiln_agree(bands->comm, status, error)) == KILN_OK &&
        MPI_Alltoallv(w->out, w->out_counts, w->out_starts, type, w->in, w->in_counts, w->in_starts, type,
                      bands->comm) != MPI_SUCCESS)
        status = mpi_failed(error);
    if (type != MPI_DATATYPE_NULL)
        (void)MPI_Type_free(&type);
    kiln_free(&w->out);
    return status;
}

/* ---- a part's points ---- */

static int compare_keys(const void *a, const void *b, void *context)
{
    const uint64_t *keys = context;
    const uint64_t p = keys[*(const uint32_t *)a], q = keys[*(const uint32_t *)b];
    return (p > q) - (p < q);
}

/* Points of other lightmaps come after all texels of this one, in the order of their keys. */
static int order_others(struct kiln_parts *p, const uint64_t *keys, size_t texels, struct kiln_error *error)
{
    uint32_t *others = NULL;
    size_t count = 0;
    const int status = kiln_allocate(&others, p->count, sizeof *others, "parts of a lightmap", error);
    for (size_t i = 0; i < p->count && status == KILN_OK; i++)
        if (keys[i] > UINT32_MAX)
            others[count++] = (uint32_t)i;
    if (count > 1)
        qsort_r(others, count, sizeof *others, compare_keys, (void *)(uintptr_t)keys);
    for (size_t i = 0; i < count; i++)
        p->points[others[i]].order = (uint32_t)(texels + i);
    kiln_free(&others);
    return status == KILN_OK && texels + count >= UINT32_MAX ? too_many(error) : status;
}

/* Takes the records, own ones in the order in which they have come. */
static int take_records(struct kiln_parts *p, const struct kiln_map *map, struct kiln_error *error)
{
    const size_t size = record_size(p->planes);
    size_t next[2] = {p->own, 0}, last = 0; /* next: of others, and of own ones */
    uint64_t *keys = NULL;
    int status = kiln_allocate_bare(&p->points, p->count, sizeof *p->points, "parts of a lightmap", error);
    for (size_t plane = 0; plane < p->planes && status == KILN_OK; plane++)
        status = kiln_allocate_bare(&p->values[plane], p->count, sizeof(float), "parts of a lightmap", error);
    if (status == KILN_OK)
        status = kiln_allocate_bare(&p->far, p->count, sizeof *p->far, "parts of a lightmap", error);
    if (status == KILN_OK)
        status = kiln_allocate_bare(&keys, p->count, sizeof *keys, "parts of a lightmap", error);
    for (size_t i = 0; i < p->count && status == KILN_OK; i++) {
        const struct record *record = (const void *)(p->way->in + i * size);
        const struct cube cube = cube_around(record->position, record->size, p->way->shift);
        const size_t index = next[record->own]++;
        if (i == 0 || compare_cubes(&p->way->all.cubes[last], &cube) != 0)
            last = find_cube(&p->way->all, &cube);
        p->far[index] = p->way->far[last];
        struct kiln_neighbour_point *point = &p->points[i];
        *point = (struct kiln_neighbour_point){
            .area = record->area, .size = record->size, .order = (uint32_t)record->key, .index = (uint32_t)index};
        memcpy(point->position, record->position, sizeof point->position);
        memcpy(point->normal, record->normal, sizeof point->normal);
        for (size_t plane = 0; plane < p->planes; plane++)
            p->values[plane][index] = record->values[plane];
        keys[i] = record->key;
    }
    if (status == KILN_OK)
        status = order_others(p, keys, kiln_map_texels(map), error);
    kiln_free(&keys);
    kiln_free(&p->way->in);
    return status;
}

/* ---- all of it ---- */

static int allocate_way(struct kiln_parts *p, const struct kiln_parts_given *given, struct kiln_error *error)
{
    struct kiln_parts_way *w = NULL;
    int status = kiln_allocate(&p->way, 1, sizeof *p->way, "parts of a lightmap", error);
    if (status == KILN_OK)
        status = kiln_allocate(&p->values, given->planes, sizeof *p->values, "parts of a lightmap", error);
    if (status != KILN_OK)
        return status;
    w = p->way;
    p->planes = given->planes;
    int **counts[] = {&w->out_counts, &w->out_starts,     &w->in_counts, &w->in_starts,
                      &w->own_out,    &w->own_out_starts, &w->own_in,    &w->own_in_starts};
    for (size_t i = 0; status == KILN_OK && i < sizeof counts / sizeof *counts; i++)
        status = kiln_allocate(counts[i], given->map->bands->ranks, sizeof(int), "parts of a lightmap", error);
    if (status == KILN_OK)
        status = kiln_allocate(&w->cube_of, given->count, sizeof *w->cube_of, "parts of a lightmap", error);
    return status;
}

/* Collective. Divides space. */
static int divide(struct kiln_parts_way *w, const struct kiln_parts_given *given, struct kiln_error *error)
{
    const struct kiln_bands *bands = given->map->bands;
    uint64_t total = given->count;
    int status = kiln_bands_count(given->map, &total, 1, error);
    while (total >> 2 * w->shift > MANY) /* of a surface cubes of twice the side are a quarter */
        w->shift++;
    if (status == KILN_OK)
        status = kiln_agree(bands->comm, list_here(w, given, error), error);
    if (status == KILN_OK)
        status = share_cubes(w, bands, error);
    if (status != KILN_OK)
        return status;
    cut(w->all.cubes, w->all.count, 0, bands->ranks);
    sort_cubes(&w->all);
    return find_needed(w, bands, error);
}

int kiln_parts_create(struct kiln_parts **parts, const struct kiln_parts_given *given, struct kiln_error *error)
{
    const struct kiln_bands *bands = given->map->bands;
    int status = kiln_allocate(parts, 1, sizeof **parts, "parts of a lightmap", error);
    if (status == KILN_OK)
        status = allocate_way(*parts, given, error);
    if ((status = kiln_agree(bands->comm, status, error)) == KILN_OK)
        status = divide((*parts)->way, given, error);
    if (status == KILN_OK)
        status = send_records((*parts)->way, given, &(*parts)->count, error);
    if (status == KILN_OK) {
        for (uint32_t r = 0; r < bands->ranks; r++)
            (*parts)->own += (size_t)(*parts)->way->own_in[r];
        status = kiln_agree(bands->comm, take_records(*parts, given->map, error), error);
    }
    if (status != KILN_OK)
        kiln_parts_destroy(parts);
    return status;
}

int kiln_parts_give_back(const struct kiln_parts *p, const struct kiln_parts_given *given, struct kiln_error *error)
{
    const struct kiln_bands *bands = given->map->bands;
    struct kiln_parts_way *w = p->way;
    MPI_Datatype type = MPI_DATATYPE_NULL;
    float *out = NULL, *in = NULL;
    int status = kiln_allocate_bare(&out, p->own, p->planes * sizeof *out, "parts of a lightmap", error);
    if (status == KILN_OK)
        status = kiln_allocate_bare(&in, given->count, p->planes * sizeof *in, "parts of a lightmap", error);
    if (status == KILN_OK)
        status = make_type(&type, p->planes * sizeof *out, error);
    for (size_t i = 0; i < p->own && status == KILN_OK; i++)
        for (size_t plane = 0; plane < p->planes; plane++)
            out[i * p->planes + plane] = p->values[plane][i];
    if ((status = kiln_agree(bands->comm, status, error)) == KILN_OK &&
        MPI_Alltoallv(out, w->own_in, w->own_in_starts, type, in, w->own_out, w->own_out_starts, type, bands->comm) !=
            MPI_SUCCESS)
        status = mpi_failed(error);
    for (size_t i = 0; i < given->count && status == KILN_OK; i++)
        for (size_t plane = 0; plane < p->planes; plane++)
            given->values[plane][given->points[w->sent_own[i]].index] = in[i * p->planes + plane];
    if (type != MPI_DATATYPE_NULL)
        (void)MPI_Type_free(&type);
    kiln_free(&out);
    kiln_free(&in);
    return status;
}

void kiln_parts_destroy(struct kiln_parts **parts)
{
    struct kiln_parts *p = *parts;
    if (p == NULL)
        return;
    struct kiln_parts_way *w = p->way;
    if (w != NULL) {
        int **counts[] = {&w->out_counts, &w->out_starts,     &w->in_counts, &w->in_starts,
                          &w->own_out,    &w->own_out_starts, &w->own_in,    &w->own_in_starts};
        for (size_t i = 0; i < sizeof counts / sizeof *counts; i++)
            kiln_free(counts[i]);
        kiln_free(&w->here.cubes);
        kiln_free(&w->all.cubes);
        kiln_free(&w->cube_of);
        kiln_free(&w->far);
        kiln_free(&w->seen);
        kiln_free(&w->first);
        kiln_free(&w->needed);
        kiln_free(&w->sent_own);
        kiln_free(&w->out);
        kiln_free(&w->in);
    }
    for (size_t plane = 0; p->values != NULL && plane < p->planes; plane++)
        kiln_free(&p->values[plane]);
    kiln_free(&p->values);
    kiln_free(&p->way);
    kiln_free(&p->points);
    kiln_free(&p->far);
    kiln_free(parts);
}
