#include "coordinator/integrate/land/merge_group.h"

#include <stdlib.h>
#include <string.h>

#include "worker/base/clones.h"
#include "worker/base/memory.h"

#define WIDE 1.5 /* largest side of a group's box, in cells */

enum { WORD = 64 };
enum { NEAR = 1, HALF = 2 }; /* bits of a byte of a candidate */

/* A candidate with its place in the order. */
struct kiln_merge_ranked {
    uint64_t cell, key;
    uint32_t at;
};

void kiln_merge_finder_release(struct kiln_merge_finder *f)
{
    kiln_free(&f->found.of);
    kiln_free(&f->columns);
    kiln_free(&f->ranked);
    kiln_free(&f->bytes);
    kiln_free(&f->which);
    kiln_free(&f->within);
    kiln_free(&f->words);
}

/* ---- groups ---- */

static float smaller(float a, float b) { return a < b ? a : b; }
static float larger(float a, float b) { return a > b ? a : b; }

static void grow_box(struct kiln_merge_box *box, struct kiln_vec3 p)
{
    box->low = vec3(smaller(box->low.x, p.x), smaller(box->low.y, p.y), smaller(box->low.z, p.z));
    box->high = vec3(larger(box->high.x, p.x), larger(box->high.y, p.y), larger(box->high.z, p.z));
}

static bool is_within(const struct kiln_merge_box *box, double most)
{
    return (double)(box->high.x - box->low.x) <= most && (double)(box->high.y - box->low.y) <= most &&
           (double)(box->high.z - box->low.z) <= most;
}

uint32_t kiln_merge_group_choose(const struct kiln_merge_grid *grid, const struct kiln_merge_place *places,
                                 size_t first, uint64_t *rest, uint32_t points[KILN_MERGE_CHUNK])
{
    struct kiln_merge_box box = {.radius = 0.0f};
    uint32_t count = 0;
    int level = 0, of_order = 0;
    double most = 0.0;
    for (uint64_t left = *rest; left != 0; left &= left - 1) {
        const size_t at = first + (size_t)__builtin_ctzll(left);
        const struct kiln_merge_place *place = &places[at];
        if (grid != NULL && count == 0) {
            box.low = box.high = place->position;
            level = kiln_merge_grid_level_of(grid, at);
            of_order = kiln_merge_grid_level(grid, place->widest);
            most = WIDE * kiln_merge_grid_side(grid, of_order);
        } else if (grid != NULL) {
            struct kiln_merge_box with = box;
            grow_box(&with, place->position);
            if (!is_within(&with, most) || level != kiln_merge_grid_level_of(grid, at) ||
                of_order != kiln_merge_grid_level(grid, place->widest))
                continue;
            box = with;
        }
        points[count++] = (uint32_t)at;
        *rest &= ~(left & -left);
    }
    return count;
}

/* ---- candidates ---- */

static int by_rank(const void *a, const void *b)
{
    const struct kiln_merge_ranked *one = a, *other = b;
    return one->cell != other->cell ? (one->cell > other->cell) - (one->cell < other->cell)
                                    : (one->key > other->key) - (one->key < other->key);
}

/* Orders candidates by the cells of another level, in which the box has far fewer than 2^20 along each side. */
static int reorder(const struct kiln_merge_grid *grid, const struct kiln_merge_place *places, int level,
                   const struct kiln_merge_box *box, struct kiln_merge_finder *f, struct kiln_error *error)
{
    enum { BITS = 21, MARGIN = 1 << 20 };
    int64_t origin[3], cell[3];
    const int status =
        kiln_grow(&f->ranked, &f->ranked_room, f->found.count, sizeof *f->ranked, "points nearby", error);
    if (status != KILN_OK)
        return status;
    kiln_merge_grid_cell(grid, level, box->low, origin);
    for (size_t i = 0; i < f->found.count; i++) {
        const struct kiln_merge_place *place = &places[f->found.of[i]];
        uint64_t rank = 0;
        kiln_merge_grid_cell(grid, level, place->position, cell);
        for (int axis = 2; axis >= 0; axis--)
            rank = rank << BITS | (uint64_t)(cell[axis] - origin[axis] + MARGIN);
        f->ranked[i] = (struct kiln_merge_ranked){rank, place->key, f->found.of[i]};
    }
    qsort(f->ranked, f->found.count, sizeof *f->ranked, by_rank);
    for (size_t i = 0; i < f->found.count; i++)
        f->found.of[i] = f->ranked[i].at;
    return KILN_OK;
}

/* Fills in the columns up to whole words; those beyond the last are near nothing. */
static int fill_columns(const struct kiln_merge_place *places, struct kiln_merge_finder *f, struct kiln_error *error)
{
    const size_t stride = (f->found.count + WORD - 1) / WORD * WORD;
    int status;
    KILN_TRY(kiln_grow(&f->columns, &f->column_room, (KILN_MERGE_COLUMNS + KILN_MERGE_WIDEST) * stride,
                       sizeof *f->columns, "points nearby", error));
    KILN_TRY(kiln_grow(&f->bytes, &f->byte_room, stride, sizeof *f->bytes, "points nearby", error));
    KILN_TRY(kiln_grow(&f->which, &f->which_room, stride, sizeof *f->which, "points nearby", error));
    KILN_TRY(kiln_grow(&f->within, &f->within_room, stride, sizeof *f->within, "points nearby", error));
    f->stride = stride;
    for (size_t i = 0; i < stride; i++) {
        static const struct kiln_merge_place none = {.widest = -1.0f};
        const struct kiln_merge_place *place = i < f->found.count ? &places[f->found.of[i]] : &none;
        const struct kiln_vec3 p = place->position, n = place->normal;
        const float values[KILN_MERGE_COLUMNS] = {p.x, p.y, p.z, n.x, n.y, n.z, place->widest};
        for (size_t c = 0; c < KILN_MERGE_COLUMNS; c++)
            f->columns[c * stride + i] = values[c];
    }
end:
    return status;
}

/* Finds the candidates of a group. */
static int find_candidates(const struct kiln_merge_grid *grid, const struct kiln_merge_place *places,
                           const uint32_t *points, uint32_t count, float radius, struct kiln_merge_finder *f,
                           struct kiln_error *error)
{
    const struct kiln_merge_place *first = &places[points[0]];
    struct kiln_merge_box box = {first->position, first->position, 0.0f};
    int status = KILN_OK;
    for (uint32_t i = 0; i < count; i++) {
        grow_box(&box, places[points[i]].position);
        box.radius = larger(box.radius, smaller(radius, places[points[i]].widest));
    }
    f->found.count = 0;
    if (grid != NULL && box.radius > 0.0f) {
        const int level = kiln_merge_grid_level_of(grid, points[0]),
                  of_order = kiln_merge_grid_level(grid, first->widest);
        status = kiln_merge_grid_find(grid, level, &box, &f->found, error);
        if (status == KILN_OK && of_order != level)
            status = reorder(grid, places, of_order, &box, f, error);
    }
    return status == KILN_OK ? fill_columns(places, f, error) : status;
}

/* ---- comparison ---- */

/* Compares candidates with a place, as kiln_merge_are_near does. */
KILN_CLONES static void look(const float *columns, size_t count, const struct kiln_merge_place *place, float radius,
                             uint8_t *bytes)
{
    const float *const x = columns, *const y = x + count, *const z = y + count, *const nx = z + count,
                       *const ny = nx + count, *const nz = ny + count, *const widest = nz + count;
    const struct kiln_vec3 p = place->position, n = place->normal;
#pragma omp simd
    for (size_t i = 0; i < count; i++) {
        const float least = radius < widest[i] ? radius : widest[i], half = 0.5f * least, dx = x[i] - p.x,
                    dy = y[i] - p.y, dz = z[i] - p.z, far = dx * dx + dy * dy + dz * dz,
                    below = fabsf(dx * n.x + dy * n.y + dz * n.z), above = fabsf(dx * nx[i] + dy * ny[i] + dz * nz[i]),
                    off = below > above ? below : above;
        const uint32_t alike =
            (uint32_t)(least > 0.0f) & (uint32_t)(n.x * nx[i] + n.y * ny[i] + n.z * nz[i] >= KILN_MERGE_ALIKE);
        bytes[i] = (uint8_t)((alike & (uint32_t)(far <= least * least) & (uint32_t)(off <= KILN_MERGE_FLAT * least)) |
                             (alike & (uint32_t)(far <= half * half) & (uint32_t)(off <= KILN_MERGE_FLAT * half)) << 1);
    }
}

/* Gathers a bit of each of 64 bytes in a word. */
static uint64_t pack(const uint8_t *bytes, int shift)
{
    uint64_t word = 0, eight;
    for (int i = 0; i < WORD / 8; i++) {
        memcpy(&eight, bytes + 8 * i, sizeof eight);
        word |= ((eight >> shift & 0x0101010101010101ull) * 0x0102040810204080ull >> 56) << 8 * i;
    }
    return word;
}

/* Fills in the masks of a point. */
static void find_near(const struct kiln_merge_finder *f, const struct kiln_merge_place *places, uint32_t at,
                      float radius, uint64_t *near, uint64_t *half)
{
    const float least = smaller(radius, places[at].widest);
    look(f->columns, f->stride, &places[at], least, f->bytes);
    for (size_t word = 0; word < f->stride / WORD; word++) {
        near[word] = pack(f->bytes + WORD * word, 0);
        half[word] = pack(f->bytes + WORD * word, 1);
    }
}

/* Takes the points of a group out of their own masks. They are in order, and candidates may be among them. */
static void leave_out_own(const struct kiln_merge_finder *f, const uint32_t *points, uint32_t count, uint64_t *near)
{
    const size_t words = f->stride / WORD;
    for (size_t c = 0; c < f->found.count; c++) {
        const uint32_t at = f->found.of[c];
        for (size_t i = 0; at - points[0] <= points[count - 1] - points[0] && i < count; i++)
            if (points[i] == at) {
                near[i * words + c / WORD] &= ~(1ull << c % WORD);
                near[(count + i) * words + c / WORD] &= ~(1ull << c % WORD);
            }
    }
}

/* Words of `count` numbers of 32 bits. */
static size_t words_of(size_t count) { return (count + 1) / 2; }

const uint64_t *kiln_merge_group_read(const uint64_t *words, struct kiln_merge_group *group)
{
    *group = (struct kiln_merge_group){.count = (uint32_t)words[0], .candidates = (uint32_t)(words[0] >> 32)};
    group->words = (group->candidates + WORD - 1) / WORD;
    words++;
    group->points = (const uint32_t *)(const void *)words;
    words += words_of(group->count);
    group->of = (const uint32_t *)(const void *)words;
    words += words_of(group->candidates);
    group->near = words;
    group->half = words += (size_t)group->count * group->words;
    return words + (size_t)group->count * group->words;
}

int kiln_merge_group_find(const struct kiln_merge_grid *grid, const struct kiln_merge_place *places,
                          const uint32_t *points, uint32_t count, float radius, struct kiln_merge_finder *f,
                          struct kiln_merge_group *group, size_t *words_used, struct kiln_error *error)
{
    int status;
    KILN_TRY(find_candidates(grid, places, points, count, radius, f, error));
    const size_t candidates = f->found.count, words = f->stride / WORD, at_of = 1 + words_of(count),
                 at_near = at_of + words_of(candidates), all = at_near + 2 * words * count;
    KILN_TRY(kiln_grow(&f->words, &f->word_room, all, sizeof *f->words, "points nearby", error));
    f->words[0] = count | (uint64_t)candidates << 32;
    memcpy(f->words + 1, points, count * sizeof *points);
    if (candidates > 0)
        memcpy(f->words + at_of, f->found.of, candidates * sizeof *f->found.of);
    for (uint32_t i = 0; i < count; i++)
        find_near(f, places, points[i], radius, f->words + at_near + i * words,
                  f->words + at_near + (count + i) * words);
    leave_out_own(f, points, count, f->words + at_near);
    (void)kiln_merge_group_read(f->words, group);
    *words_used = all;
end:
    return status;
}

/* Compares candidates with a place by each of the radii. */
KILN_CLONES static void count_radii(const float *columns, size_t stride, size_t count,
                                    const struct kiln_merge_place *place, const float radii[KILN_MERGE_RINGS],
                                    uint32_t *within)
{
    const float *const x = columns, *const y = x + stride, *const z = y + stride, *const nx = z + stride,
                       *const ny = nx + stride, *const nz = ny + stride;
    const struct kiln_vec3 p = place->position, n = place->normal;
#pragma omp simd
    for (size_t i = 0; i < count; i++) {
        const float dx = x[i] - p.x, dy = y[i] - p.y, dz = z[i] - p.z, far = dx * dx + dy * dy + dz * dz,
                    below = fabsf(dx * n.x + dy * n.y + dz * n.z), above = fabsf(dx * nx[i] + dy * ny[i] + dz * nz[i]),
                    off = below > above ? below : above;
        uint32_t inside = 0;
#pragma GCC unroll 8
        for (size_t k = 0; k < KILN_MERGE_RINGS; k++)
            inside += (uint32_t)(far <= radii[k] * radii[k]) & (uint32_t)(off <= KILN_MERGE_FLAT * radii[k]);
        within[i] = inside;
    }
}

size_t kiln_merge_group_rings(struct kiln_merge_finder *f, const struct kiln_merge_group *group, size_t point,
                              const struct kiln_merge_place *place, const float radii[KILN_MERGE_RINGS])
{
    float *const near = f->columns + KILN_MERGE_COLUMNS * f->stride;
    size_t count = 0;
    for (size_t word = 0; word < group->words; word++)
        for (uint64_t rest = group->near[point * group->words + word]; rest != 0; rest &= rest - 1) {
            const size_t c = WORD * word + (size_t)__builtin_ctzll(rest);
            f->which[count] = (uint32_t)c;
            for (size_t column = 0; column < KILN_MERGE_WIDEST; column++)
                near[column * f->stride + count] = f->columns[column * f->stride + c];
            count++;
        }
    count_radii(near, f->stride, count, place, radii, f->within);
    return count;
}
