#include "coordinator/output/map/denoise/denoise_parts.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/exchange.h"
#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/bands/slices.h"
#include "worker/base/memory.h"

/* MANY: points of a lightmap above which cubes are larger than the cells of neighbours.h; each cell lies in one cube.
 * FARTHEST: largest number of a cube along an axis. */
enum { MANY = 1 << 24, FARTHEST = KILN_NEIGHBOUR_FARTHEST };

/* Reach of each sweep of the regression, in texels; the last sweep comes first. */
static const float hops[] = {KILN_NEIGHBOUR_RADIUS, 6.0f, 6.0f, KILN_NEIGHBOUR_RADIUS};
enum { HOPS = sizeof hops / sizeof *hops };

/* A cube that contains points whose texel size is 2^level to 2^(level + 1) m. */
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
    uint32_t own, unused; /* own: it belongs to the subdomain */
    float values[];
};

struct kiln_subdomain_way {
    int shift;              /* cubes have a side of KILN_NEIGHBOUR_CELL << shift texels */
    struct cubes here, all; /* cubes of own points, and of all ranks' points; sorted by place, none twice */
    uint32_t *cube_of;      /* of each own point, in `here` */
    uint8_t *far;           /* one per cube in `all`; KILN_SUBDOMAIN_FAR: this rank does not see the cube */
    uint32_t *seen;         /* indices in `all` of the cubes that this rank sees, its own first */
    size_t seen_count;
    uint32_t *here_of;  /* one per cube in `all`: its index in `here`; KILN_NONE: not there */
    size_t *first;      /* one per cube in `here`, and the end: where its entries in `needed` begin */
    uint32_t *needed;   /* parts that need the cube's points; first the part that owns them */
    uint32_t *sent_own; /* per part: points sent to it as its own */
    int slices;         /* of own points */
    size_t (*sent)[2];  /* per slice and rank: records, and own ones; later the next places to write */
    unsigned char *out, *in;
    int *counts, *starts;                 /* of what each rank shares with all */
    struct kiln_exchange everything, own; /* records that are sent; those of them that are own where they come */
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

/* Sorts the cubes, and merges those at the same place into one. */
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

static struct cube cube_around(const float position[3], float size, int shift)
{
    struct cube cube = {.level = kiln_neighbour_level(size), .size = size, .count = 1};
    const double scale = kiln_neighbour_scale(cube.level + shift);
    for (int c = 0; c < 3; c++) {
        cube.at[c] = kiln_neighbour_along(position[c], scale);
        cube.low[c] = cube.high[c] = position[c];
    }
    return cube;
}

/* Lists the cubes of the points [begin, end). Points that follow one another often share one. */
static int list_slice(struct cubes *cubes, const struct kiln_subdomain_given *given, int shift, size_t begin,
                      size_t end, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = begin; i < end && status == KILN_OK; i++) {
        const struct cube cube = cube_around(given->points[i].position, given->points[i].size, shift);
        if (cubes->count > 0 && compare_cubes(&cubes->cubes[cubes->count - 1], &cube) == 0) {
            join_cubes(&cubes->cubes[cubes->count - 1], &cube);
            continue;
        }
        status =
            kiln_grow(&cubes->cubes, &cubes->capacity, cubes->count + 1, sizeof cube, "parts of a lightmap", error);
        if (status == KILN_OK)
            cubes->cubes[cubes->count++] = cube;
    }
    sort_cubes(cubes);
    return status;
}

/* Makes one list of those of all slices. */
static int join_lists(struct cubes *all, const struct cubes *lists, int slices, struct kiln_error *error)
{
    size_t total = 0;
    for (int t = 0; t < slices; t++)
        total += lists[t].count;
    const int status = kiln_grow(&all->cubes, &all->capacity, total, sizeof *all->cubes, "parts of a lightmap", error);
    for (int t = 0; t < slices && status == KILN_OK; t++) {
        if (lists[t].count > 0)
            memcpy(all->cubes + all->count, lists[t].cubes, lists[t].count * sizeof *all->cubes);
        all->count += lists[t].count;
    }
    sort_cubes(all);
    return status;
}

/* Finds the cubes of own points in `here`. */
static void find_cubes(struct kiln_subdomain_way *w, const struct kiln_subdomain_given *given)
{
#pragma omp parallel for num_threads(w->slices) schedule(static)
    for (int t = 0; t < w->slices; t++) {
        size_t begin, end, last = 0;
        kiln_slice(w->slices, t, given->count, &begin, &end);
        for (size_t i = begin; i < end; i++) {
            const struct cube cube = cube_around(given->points[i].position, given->points[i].size, w->shift);
            if (i == begin || compare_cubes(&w->here.cubes[last], &cube) != 0)
                last = find_cube(&w->here, &cube);
            w->cube_of[i] = (uint32_t)last;
        }
    }
}

/* Lists the cubes of own points. */
static int list_here(struct kiln_subdomain_way *w, const struct kiln_subdomain_given *given, struct kiln_error *error)
{
    struct cubes *lists = NULL;
    int status = kiln_allocate(&lists, (size_t)w->slices, sizeof *lists, "parts of a lightmap", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads(w->slices) schedule(static)
    for (int t = 0; t < w->slices; t++) {
        struct kiln_error mine = {{0}};
        size_t begin, end;
        kiln_slice(w->slices, t, given->count, &begin, &end);
        const int listed = list_slice(&lists[t], given, w->shift, begin, end, &mine);
        if (listed != KILN_OK)
#pragma omp critical(kiln_parts_list)
            status = kiln_fail(error, listed, "%s", mine.message);
    }
    if (status == KILN_OK)
        status = join_lists(&w->here, lists, w->slices, error);
    if (status == KILN_OK)
        find_cubes(w, given);
    for (int t = 0; t < w->slices; t++)
        kiln_free(&lists[t].cubes);
    kiln_free(&lists);
    return status;
}

/* Lists where each rank's records begin. Returns the number of all; SIZE_MAX: too many for a message. */
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

/* Collective. Tells all ranks the cubes of all ranks. */
static int share_cubes(struct kiln_subdomain_way *w, const struct kiln_bands *bands, struct kiln_error *error)
{
    const int mine = w->here.count < INT_MAX ? (int)w->here.count : -1;
    MPI_Datatype type = MPI_DATATYPE_NULL;
    size_t total = 0;
    if (MPI_Allgather(&mine, 1, MPI_INT, w->counts, 1, MPI_INT, bands->comm) != MPI_SUCCESS)
        return mpi_failed(error);
    int status;
    KILN_TRY((total = begin_all(w->counts, w->starts, bands->ranks)) == SIZE_MAX ? too_many(error) : KILN_OK);
    KILN_TRY(kiln_grow(&w->all.cubes, &w->all.capacity, total, sizeof(struct cube), "parts of a lightmap", error));
    KILN_TRY(make_type(&type, sizeof(struct cube), error));
end:
    if ((status = kiln_agree(bands->comm, status, error)) == KILN_OK &&
        MPI_Allgatherv(w->here.cubes, mine, type, w->all.cubes, w->counts, w->starts, type, bands->comm) != MPI_SUCCESS)
        status = mpi_failed(error);
    if (type != MPI_DATATYPE_NULL)
        (void)MPI_Type_free(&type);
    w->all.count = status == KILN_OK ? total : 0;
    sort_cubes(&w->all);
    return status;
}

/* ---- parts ---- */

/* A cube, and twice its middle along an axis. */
struct place {
    float middle;
    uint32_t cube;
};

static int compare_places(const void *a, const void *b)
{
    const struct place *p = a, *q = b;
    if (p->middle != q->middle)
        return p->middle < q->middle ? -1 : 1;
    return (p->cube > q->cube) - (p->cube < q->cube);
}

static int longest_axis(const struct cube *cubes, const struct place *places, size_t count)
{
    struct cube all = cubes[places[0].cube];
    int axis = 0;
    for (size_t i = 1; i < count; i++)
        join_cubes(&all, &cubes[places[i].cube]);
    for (int c = 1; c < 3; c++)
        axis = all.high[c] - all.low[c] > all.high[axis] - all.low[axis] ? c : axis;
    return axis;
}

/* Divides cubes between the parts [first, first + parts). */
static void cut(struct cube *cubes, struct place *places, size_t count, uint32_t first, uint32_t parts)
{
    if (parts == 1 || count == 0) {
        for (size_t i = 0; i < count; i++)
            cubes[places[i].cube].part = first;
        return;
    }
    const int axis = longest_axis(cubes, places, count);
    const uint32_t half = parts / 2;
    uint64_t total = 0, before = 0;
    size_t at = 0;
    for (size_t i = 0; i < count; i++) {
        const struct cube *cube = &cubes[places[i].cube];
        places[i].middle = cube->low[axis] + cube->high[axis];
        total += cube->count;
    }
    qsort(places, count, sizeof *places, compare_places);
    /* take cubes until the points before the cut are nearest to the share of these parts */
    while (at < count && (2 * before + cubes[places[at].cube].count) * parts < 2 * total * half)
        before += cubes[places[at++].cube].count;
    cut(cubes, places, at, first, half);
    cut(cubes, places + at, count - at, first + half, parts - half);
}

static int cut_all(struct cubes *all, uint32_t parts, struct kiln_error *error)
{
    struct place *places = NULL;
    const int status = kiln_allocate_bare(&places, all->count, sizeof *places, "parts of a lightmap", error);
    for (size_t i = 0; i < all->count && status == KILN_OK; i++)
        places[i] = (struct place){.cube = (uint32_t)i};
    if (status == KILN_OK)
        cut(all->cubes, places, all->count, 0, parts);
    kiln_free(&places);
    return status;
}

/* ---- what a part sees ---- */

static bool is_near(const struct cube *a, const struct cube *b, float reach)
{
    for (int c = 0; c < 3; c++)
        if (b->low[c] > a->high[c] + reach || b->high[c] < a->low[c] - reach)
            return false;
    return true;
}

/* Adds a cube, unless it has been seen. Several threads may add cubes of one hop. */
static void see_cube(struct kiln_subdomain_way *w, size_t cube, uint8_t far)
{
    uint8_t before;
    size_t at;
#pragma omp atomic read
    before = w->far[cube];
    if (before != KILN_SUBDOMAIN_FAR)
        return;
#pragma omp atomic capture
    {
        before = w->far[cube];
        w->far[cube] = far;
    }
    if (before != KILN_SUBDOMAIN_FAR)
        return;
#pragma omp atomic capture
    at = w->seen_count++;
    w->seen[at] = (uint32_t)cube;
}

/* Adds the cubes of one level near a cube that are not yet seen. */
static void see_level(struct kiln_subdomain_way *w, const struct cube *from, int level, float reach, uint8_t far)
{
    struct cube key = {.level = level, .at = {-FARTHEST, -FARTHEST, -FARTHEST}};
    const double scale = kiln_neighbour_scale(level + w->shift);
    int32_t low[3], high[3];
    const size_t begin = find_cube(&w->all, &key);
    if (begin == w->all.count || w->all.cubes[begin].level != level)
        return;
    for (int c = 0; c < 3; c++) {
        low[c] = kiln_neighbour_along(from->low[c] - reach, scale);
        high[c] = kiln_neighbour_along(from->high[c] + reach, scale);
    }
    for (key.at[0] = low[0]; key.at[0] <= high[0]; key.at[0]++)
        for (key.at[1] = low[1]; key.at[1] <= high[1]; key.at[1]++) {
            key.at[2] = low[2];
            for (size_t i = find_cube(&w->all, &key); i < w->all.count; i++) {
                const struct cube *cube = &w->all.cubes[i];
                if (cube->level != level || cube->at[0] != key.at[0] || cube->at[1] != key.at[1] ||
                    cube->at[2] > high[2])
                    break;
                if (is_near(from, cube, reach))
                    see_cube(w, i, far);
            }
        }
}

/* Lists the cubes that this rank sees, hop by hop. In the last sweep a point depends on points near it; these depend in
 * the sweep before on points near them, and so on. Texels of neighbours are less than four times as large or small, so
 * at most one level above or below is searched. */
static int see(struct kiln_subdomain_way *w, uint32_t part, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_allocate_bare(&w->far, w->all.count, sizeof *w->far, "parts of a lightmap", error));
    KILN_TRY(kiln_allocate_bare(&w->seen, w->all.count, sizeof *w->seen, "parts of a lightmap", error));
    for (size_t i = 0; i < w->all.count; i++) {
        w->far[i] = w->all.cubes[i].part == part ? 0 : KILN_SUBDOMAIN_FAR;
        if (w->far[i] == 0)
            w->seen[w->seen_count++] = (uint32_t)i;
    }
    for (uint8_t hop = 0; hop < HOPS; hop++) {
        const size_t end = w->seen_count;
#pragma omp parallel for schedule(dynamic, 64)
        for (size_t i = 0; i < end; i++) {
            const struct cube *from = &w->all.cubes[w->seen[i]];
            const float reach = 1.001f * hops[hop] * from->size; /* slightly more, since distances are rounded */
            for (int level = from->level - 1; level <= from->level + 1; level++)
                see_level(w, from, level, reach, (uint8_t)(hop + 1));
        }
    }
end:
    return status;
}

/* Collective. Gathers the lists of seen cubes of all ranks, one after the other. */
static int share_seen(struct kiln_subdomain_way *w, const struct kiln_bands *bands, uint32_t **seen,
                      struct kiln_error *error)
{
    const int mine = w->seen_count < INT_MAX ? (int)w->seen_count : -1;
    size_t total = 0;
    if (MPI_Allgather(&mine, 1, MPI_INT, w->counts, 1, MPI_INT, bands->comm) != MPI_SUCCESS)
        return mpi_failed(error);
    int status = (total = begin_all(w->counts, w->starts, bands->ranks)) == SIZE_MAX ? too_many(error) : KILN_OK;
    if (status == KILN_OK)
        status = kiln_allocate_bare(seen, total, sizeof **seen, "parts of a lightmap", error);
    if ((status = kiln_agree(bands->comm, status, error)) == KILN_OK &&
        MPI_Allgatherv(w->seen, mine, MPI_UINT32_T, *seen, w->counts, w->starts, MPI_UINT32_T, bands->comm) !=
            MPI_SUCCESS)
        status = mpi_failed(error);
    return status;
}

/* Calls `visit` for each part that sees a cube in which this rank has points: first the part that owns the cube. */
static void visit_needed(struct kiln_subdomain_way *w, const uint32_t *seen, uint32_t ranks,
                         void (*visit)(struct kiln_subdomain_way *, size_t here, uint32_t part))
{
    for (int others = 0; others < 2; others++)
        for (uint32_t part = 0; part < ranks; part++)
            for (int i = 0; i < w->counts[part]; i++) {
                const uint32_t cube = seen[w->starts[part] + i], here = w->here_of[cube];
                if ((w->all.cubes[cube].part != part) == (others == 1) && here != KILN_NONE)
                    visit(w, here, part);
            }
}

static void count_needed(struct kiln_subdomain_way *w, size_t here, uint32_t part)
{
    (void)part;
    w->first[here + 1]++;
}

static void list_needed(struct kiln_subdomain_way *w, size_t here, uint32_t part)
{
    w->needed[w->first[here]++] = part;
}

/* Finds which cubes in `all` contain own points. */
static int find_here(struct kiln_subdomain_way *w, struct kiln_error *error)
{
    const int status = kiln_allocate_bare(&w->here_of, w->all.count, sizeof *w->here_of, "parts of a lightmap", error);
    for (size_t i = 0, here = 0; i < w->all.count && status == KILN_OK; i++) {
        const bool same = here < w->here.count && compare_cubes(&w->all.cubes[i], &w->here.cubes[here]) == 0;
        w->here_of[i] = same ? (uint32_t)here++ : KILN_NONE;
    }
    return status;
}

/* Collective. Lists the subdomains that need the points of each own cube. */
static int find_needed(struct kiln_subdomain_way *w, const struct kiln_bands *bands, struct kiln_error *error)
{
    const size_t count = w->here.count;
    uint32_t *seen = NULL;
    int status;
    KILN_TRY(kiln_allocate(&w->first, count + 1, sizeof *w->first, "parts of a lightmap", error));
    KILN_TRY(find_here(w, error));
    KILN_TRY(see(w, bands->rank, error));
end:
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

/* ---- to the subdomains ---- */

static size_t record_size(size_t planes)
{
    const size_t size = sizeof(struct record) + planes * sizeof(float);
    return (size + _Alignof(struct record) - 1) / _Alignof(struct record) * _Alignof(struct record);
}

/* Counts what a slice sends. */
static void count_slice(struct kiln_subdomain_way *w, size_t count, uint32_t ranks, int slice)
{
    size_t(*sent)[2] = w->sent + (size_t)slice * ranks, begin, end;
    kiln_slice(w->slices, slice, count, &begin, &end);
    for (size_t i = begin; i < end; i++)
        for (size_t k = w->first[w->cube_of[i]]; k < w->first[w->cube_of[i] + 1]; k++) {
            sent[w->needed[k]][0]++;
            sent[w->needed[k]][1] += k == w->first[w->cube_of[i]];
        }
}

/* Counts the records for each rank, and those that the rank will own. Finds where each slice writes its records. */
static int count_records(struct kiln_subdomain_way *w, const struct kiln_subdomain_given *given, uint32_t ranks,
                         struct kiln_error *error)
{
    size_t next[2] = {0};
    int status = kiln_allocate(&w->sent, (size_t)w->slices * ranks, sizeof *w->sent, "parts of a lightmap", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads(w->slices) schedule(static)
    for (int t = 0; t < w->slices; t++)
        count_slice(w, given->count, ranks, t);
    for (uint32_t r = 0; r < ranks; r++) {
        const size_t before[2] = {next[0], next[1]};
        for (int t = 0; t < w->slices; t++)
            for (int k = 0; k < 2; k++) {
                size_t *at = &w->sent[(size_t)t * ranks + r][k];
                const size_t here = *at;
                *at = next[k];
                next[k] += here;
            }
        w->everything.sent[r] = next[0] - before[0];
        w->own.sent[r] = next[1] - before[1];
    }
    kiln_exchange_lay_out(&w->everything);
    kiln_exchange_lay_out(&w->own);
    return KILN_OK;
}

static void fill_record(struct record *record, const struct kiln_subdomain_given *given, size_t i, bool own)
{
    const struct kiln_neighbour_point *p = &given->points[i];
    *record = (struct record){.area = p->area, .size = p->size, .key = given->keys[i], .own = own};
    memcpy(record->position, p->position, sizeof record->position);
    memcpy(record->normal, p->normal, sizeof record->normal);
    for (size_t plane = 0; plane < given->planes; plane++)
        record->values[plane] = given->values[plane][p->index];
}

/* Packs the records of a slice by rank, in the order of points. */
static void pack_slice(struct kiln_subdomain_way *w, const struct kiln_subdomain_given *given, uint32_t ranks,
                       int slice)
{
    const size_t size = record_size(given->planes);
    size_t(*sent)[2] = w->sent + (size_t)slice * ranks, begin, end;
    kiln_slice(w->slices, slice, given->count, &begin, &end);
    for (size_t i = begin; i < end; i++)
        for (size_t k = w->first[w->cube_of[i]]; k < w->first[w->cube_of[i] + 1]; k++) {
            size_t *next = sent[w->needed[k]];
            const bool own = k == w->first[w->cube_of[i]];
            fill_record((void *)(w->out + next[0]++ * size), given, i, own);
            if (own)
                w->sent_own[next[1]++] = (uint32_t)i;
        }
}

static void pack_records(struct kiln_subdomain_way *w, const struct kiln_subdomain_given *given, uint32_t ranks)
{
#pragma omp parallel for num_threads(w->slices) schedule(static)
    for (int t = 0; t < w->slices; t++)
        pack_slice(w, given, ranks, t);
    kiln_free(&w->sent);
}

/* Not collective. Lays down the records to send. */
static int lay_down(struct kiln_subdomain_way *w, const struct kiln_subdomain_given *given, struct kiln_error *error)
{
    const char *what = "parts of a lightmap";
    const uint32_t ranks = given->map->bands->ranks;
    int status;
    KILN_TRY(count_records(w, given, ranks, error));
    KILN_TRY(kiln_allocate_bare(&w->sent_own, given->count, sizeof *w->sent_own, what, error));
    KILN_TRY(kiln_allocate_bare(&w->out, w->everything.sent_all, record_size(given->planes), what, error));
    pack_records(w, given, ranks);
end:
    return status;
}

/* Collective. Sends all records. */
static int send_records(struct kiln_subdomain_way *w, const struct kiln_subdomain_given *given,
                        struct kiln_error *error)
{
    const size_t size = record_size(given->planes);
    int status;
    KILN_TRY(kiln_exchange_count(&w->own, lay_down(w, given, error), error));
    KILN_TRY(kiln_exchange_count(&w->everything, KILN_OK, error));
    status = w->everything.got_all > INT_MAX /* they get numbers of 32 bits */
                 ? too_many(error)
                 : kiln_allocate_bare(&w->in, w->everything.got_all, size, "parts of a lightmap", error);
    KILN_TRY(kiln_exchange_send(&w->everything, status, size, w->out, w->in, error));
    kiln_exchange_turn(&w->own); /* their values come back */
end:
    kiln_free(&w->out);
    return status;
}

/* ---- a subdomain's points ---- */

static int compare_keys(const void *a, const void *b, void *context)
{
    const uint64_t *keys = context;
    const uint64_t p = keys[*(const uint32_t *)a], q = keys[*(const uint32_t *)b];
    return (p > q) - (p < q);
}

/* Sorts points of other lightmaps by their keys; they come after all texels of this lightmap. */
static int order_others(struct kiln_subdomain *p, const uint64_t *keys, size_t texels, struct kiln_error *error)
{
    uint32_t *others = NULL;
    size_t many = 0, count = 0;
#pragma omp parallel for schedule(static) reduction(+ : many)
    for (size_t i = 0; i < p->count; i++)
        many += keys[i] > UINT32_MAX;
    if (many == 0)
        return KILN_OK;
    const int status = kiln_allocate_bare(&others, many, sizeof *others, "parts of a lightmap", error);
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

static const struct record *record_at(const struct kiln_subdomain *p, size_t i)
{
    return (const void *)(p->way->in + i * record_size(p->planes));
}

/* Takes the records [begin, end). next: places to write the next record of others, and the next own one. */
static void take_slice(struct kiln_subdomain *p, size_t begin, size_t end, size_t next[2], uint64_t *keys)
{
    size_t last = 0;
    for (size_t i = begin; i < end; i++) {
        const struct record *record = record_at(p, i);
        const struct cube cube = cube_around(record->position, record->size, p->way->shift);
        const size_t index = next[record->own]++;
        if (i == begin || compare_cubes(&p->way->all.cubes[last], &cube) != 0)
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
}

/* Takes all records; own ones stay in the order in which they arrived. */
static int take_slices(struct kiln_subdomain *p, uint64_t *keys, struct kiln_error *error)
{
    const int slices = kiln_slices(p->count);
    size_t(*next)[2] = NULL, own = 0;
    const int status = kiln_allocate(&next, (size_t)slices, sizeof *next, "parts of a lightmap", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads(slices) schedule(static)
    for (int t = 0; t < slices; t++) {
        size_t begin, end, count = 0;
        kiln_slice(slices, t, p->count, &begin, &end);
        for (size_t i = begin; i < end; i++)
            count += record_at(p, i)->own;
        next[t][1] = count;
    }
    for (int t = 0; t < slices; t++) {
        size_t begin, end;
        kiln_slice(slices, t, p->count, &begin, &end);
        const size_t here = next[t][1];
        next[t][0] = p->own + begin - own;
        next[t][1] = own;
        own += here;
    }
#pragma omp parallel for num_threads(slices) schedule(static)
    for (int t = 0; t < slices; t++) {
        size_t begin, end;
        kiln_slice(slices, t, p->count, &begin, &end);
        take_slice(p, begin, end, next[t], keys);
    }
    kiln_free(&next);
    return KILN_OK;
}

static int take_records(struct kiln_subdomain *p, const struct kiln_map *map, struct kiln_error *error)
{
    uint64_t *keys = NULL;
    int status;
    KILN_TRY(kiln_allocate_bare(&p->points, p->count, sizeof *p->points, "parts of a lightmap", error));
    for (size_t plane = 0; plane < p->planes; plane++)
        KILN_TRY(kiln_allocate_bare(&p->values[plane], p->count, sizeof(float), "parts of a lightmap", error));
    KILN_TRY(kiln_allocate_bare(&p->far, p->count, sizeof *p->far, "parts of a lightmap", error));
    KILN_TRY(kiln_allocate_bare(&keys, p->count, sizeof *keys, "parts of a lightmap", error));
    KILN_TRY(take_slices(p, keys, error));
    KILN_TRY(order_others(p, keys, kiln_map_texels(map), error));
end:
    kiln_free(&keys);
    kiln_free(&p->way->in);
    return status;
}

/* ---- all of it ---- */

static int allocate_way(struct kiln_subdomain *p, const struct kiln_subdomain_given *given, struct kiln_error *error)
{
    struct kiln_subdomain_way *w = NULL;
    int status = kiln_allocate(&p->way, 1, sizeof *p->way, "parts of a lightmap", error);
    if (status == KILN_OK)
        status = kiln_allocate(&p->values, given->planes, sizeof *p->values, "parts of a lightmap", error);
    if (status != KILN_OK)
        return status;
    w = p->way;
    p->planes = given->planes;
    int **counts[] = {&w->counts, &w->starts};
    for (size_t i = 0; status == KILN_OK && i < sizeof counts / sizeof *counts; i++)
        status = kiln_allocate(counts[i], given->map->bands->ranks, sizeof(int), "parts of a lightmap", error);
    w->slices = kiln_slices(given->count);
    if (status == KILN_OK)
        status = kiln_allocate_bare(&w->cube_of, given->count, sizeof *w->cube_of, "parts of a lightmap", error);
    return status;
}

/* Collective. Divides space. */
static int divide(struct kiln_subdomain_way *w, const struct kiln_subdomain_given *given, struct kiln_error *error)
{
    const struct kiln_bands *bands = given->map->bands;
    uint64_t total = given->count;
    int status = kiln_bands_count(given->map, &total, 1, error);
    while (total >> 2 * w->shift > MANY) /* a surface crosses a quarter as many cubes when their side is doubled */
        w->shift++;
    if (status == KILN_OK)
        status = kiln_agree(bands->comm, list_here(w, given, error), error);
    if (status == KILN_OK)
        status = share_cubes(w, bands, error);
    if (status != KILN_OK)
        return status;
    status = kiln_agree(bands->comm, cut_all(&w->all, bands->ranks, error), error);
    return status == KILN_OK ? find_needed(w, bands, error) : status;
}

int kiln_subdomain_create(struct kiln_subdomain **parts, const struct kiln_subdomain_given *given,
                          struct kiln_error *error)
{
    const struct kiln_bands *bands = given->map->bands;
    int status = kiln_allocate(parts, 1, sizeof **parts, "parts of a lightmap", error);
    if (status == KILN_OK)
        status = allocate_way(*parts, given, error);
    KILN_TRY(kiln_agree(bands->comm, status, error));
    struct kiln_subdomain_way *w = (*parts)->way;
    KILN_TRY(kiln_exchange_create(&w->everything, bands->comm, 0, "points of parts of a lightmap", error));
    KILN_TRY(kiln_exchange_create(&w->own, bands->comm, 0, "points of parts of a lightmap", error));
    KILN_TRY(divide(w, given, error));
    KILN_TRY(send_records(w, given, error));
    (*parts)->count = w->everything.got_all;
    (*parts)->own = w->own.sent_all;
    KILN_TRY(kiln_agree(bands->comm, take_records(*parts, given->map, error), error));
end:
    if (status != KILN_OK)
        kiln_subdomain_destroy(parts);
    return status;
}

int kiln_subdomain_give_back(const struct kiln_subdomain *p, const struct kiln_subdomain_given *given,
                             struct kiln_error *error)
{
    struct kiln_subdomain_way *w = p->way;
    float *out = NULL, *in = NULL;
    int status = kiln_allocate_bare(&out, p->own, p->planes * sizeof *out, "parts of a lightmap", error);
    if (status == KILN_OK)
        status = kiln_allocate_bare(&in, given->count, p->planes * sizeof *in, "parts of a lightmap", error);
#pragma omp parallel for schedule(static) if (status == KILN_OK)
    for (size_t i = 0; i < (status == KILN_OK ? p->own : 0); i++)
        for (size_t plane = 0; plane < p->planes; plane++)
            out[i * p->planes + plane] = p->values[plane][i];
    status = kiln_exchange_send(&w->own, status, p->planes * sizeof *out, out, in, error);
#pragma omp parallel for schedule(static) if (status == KILN_OK)
    for (size_t i = 0; i < (status == KILN_OK ? given->count : 0); i++)
        for (size_t plane = 0; plane < p->planes; plane++)
            given->values[plane][given->points[w->sent_own[i]].index] = in[i * p->planes + plane];
    kiln_free(&out);
    kiln_free(&in);
    return status;
}

void kiln_subdomain_destroy(struct kiln_subdomain **parts)
{
    struct kiln_subdomain *p = *parts;
    if (p == NULL)
        return;
    struct kiln_subdomain_way *w = p->way;
    if (w != NULL) {
        kiln_exchange_release(&w->everything);
        kiln_exchange_release(&w->own);
        kiln_free(&w->counts);
        kiln_free(&w->starts);
        kiln_free(&w->here.cubes);
        kiln_free(&w->all.cubes);
        kiln_free(&w->cube_of);
        kiln_free(&w->far);
        kiln_free(&w->seen);
        kiln_free(&w->here_of);
        kiln_free(&w->sent);
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
