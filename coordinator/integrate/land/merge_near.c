#include "coordinator/integrate/land/merge_near.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/integrate/land/bins.h"
#include "worker/base/clones.h"
#include "worker/base/memory.h"

#define SLACK 1.001f  /* margin of a cell beyond the radius, against rounding */
#define BEYOND 1.0001 /* margin of the radius for cells that can be skipped, against rounding */

enum { LEVELS = 8, NEIGHBOUR_CELLS = 27 };
enum { STRETCHES_MOST = 1 << 12 }; /* ranges of slots, each filled by one thread */
enum { POINTS_A_SLOT = 8 };        /* a cell has some thirty points, so the table of slots stays small */
enum { LANES = 64 };               /* points that are looked at together */
enum { FEW = 96 };                 /* members of a slot that are sorted by insertion */

/* A point with its key. */
struct member {
    uint64_t key;
    uint32_t at;
};

/* Values of a point in its slot, by column: they are looked through from the first to the last. */
enum { X, Y, Z, AXES };

/* A hash table of cells: points begin[h] .. begin[h + 1] - 1 have the hash h. Without `begin` no point uses the level.
 */
struct level {
    double side; /* m, of a cell */
    size_t *begin;
    uint32_t *at, *tag;    /* numbers of points, and tags of their cells */
    float *position[AXES]; /* as in their places; the first is the block */
};

struct kiln_merge_grid {
    const struct kiln_merge_place *places;
    float radius;
    size_t slots;   /* a power of two */
    uint8_t *level; /* of each place, when the grid was made */
    struct level levels[LEVELS];
};

int kiln_merge_grid_level(const struct kiln_merge_grid *grid, float widest)
{
    int level = 0;
    for (float half = 0.5f * grid->radius; level + 1 < LEVELS && widest <= half; half *= 0.5f)
        level++;
    return level;
}

static int64_t cell_along(const struct level *level, float x)
{
    const double most_cells = 0x1p60, at = (double)x / level->side,
                 within = at > most_cells    ? most_cells
                          : at < -most_cells ? -most_cells
                                             : at;
    const int64_t cell = (int64_t)within; /* no call of floor */
    return cell - (within < (double)cell);
}

/* Packs a cell's coordinates into one word. Only cells far from each other have the same word. */
static uint64_t cell_word(int64_t x, int64_t y, int64_t z)
{
    const uint64_t mask = (1u << 21) - 1u;
    return ((uint64_t)x & mask) | ((uint64_t)y & mask) << 21 | ((uint64_t)z & mask) << 42;
}

static uint64_t cell_of(const struct level *level, struct kiln_vec3 p)
{
    return cell_word(cell_along(level, p.x), cell_along(level, p.y), cell_along(level, p.z));
}

/* Tells cells of one slot apart that stand less than 2^10 cells from each other. */
static uint32_t tag_of(uint64_t word)
{
    return (uint32_t)((word & 0x7ff) | (word >> 21 & 0x7ff) << 11 | (word >> 42 & 0x3ff) << 22);
}

static size_t slot_of(const struct kiln_merge_grid *grid, uint64_t cell)
{
    return (size_t)(cell * 0x9e3779b97f4a7c15ull >> 32) & (grid->slots - 1);
}

/* A cell about a place, and the slot of its points. */
struct cell {
    uint64_t word;
    size_t slot;
};

/* Distances of a place, in cells, from the cell before, from its own (0), and from the cell behind. */
static void find_gaps(const struct level *level, float x, int64_t cell, double gaps[3])
{
    const double in_cell = fmax(0.0, fmin((double)x / level->side - (double)cell, 1.0));
    gaps[0] = in_cell;
    gaps[1] = 0.0;
    gaps[2] = 1.0 - in_cell;
}

/* The cells of a level within the radius of a place. Returns how many. */
static size_t find_cells(const struct kiln_merge_grid *grid, const struct level *level, struct kiln_vec3 p,
                         float radius, struct cell cells[NEIGHBOUR_CELLS])
{
    const int64_t x = cell_along(level, p.x), y = cell_along(level, p.y), z = cell_along(level, p.z);
    const double far = BEYOND * (double)radius / level->side;
    double gaps[3][3];
    size_t count = 0;
    find_gaps(level, p.x, x, gaps[0]);
    find_gaps(level, p.y, y, gaps[1]);
    find_gaps(level, p.z, z, gaps[2]);
    for (int i = 0; i < NEIGHBOUR_CELLS; i++) {
        const double a = gaps[0][i % 3], b = gaps[1][i / 3 % 3], c = gaps[2][i / 9];
        if (a * a + b * b + c * c > far * far)
            continue;
        const uint64_t word = cell_word(x + i % 3 - 1, y + i / 3 % 3 - 1, z + i / 9 - 1);
        cells[count] = (struct cell){word, slot_of(grid, word)};
        count++;
    }
    return count;
}

/* The points that are near others, each with its key. Returns how many. */
static size_t list_members(const struct kiln_merge_place *places, size_t count, struct member *members)
{
    size_t taking_part = 0;
    for (size_t i = 0; i < count; i++)
        if (places[i].lit > 0.0f && places[i].widest > 0.0f)
            members[taking_part++] = (struct member){places[i].key, (uint32_t)i};
    return taking_part;
}

static int by_key(const void *a, const void *b)
{
    const struct member *one = a, *other = b;
    return (one->key > other->key) - (one->key < other->key);
}

/* Sorts by key. Members come nearly in order. */
static void sort_by_key(struct member *members, size_t count)
{
    if (count > FEW) {
        qsort(members, count, sizeof *members, by_key);
        return;
    }
    for (size_t i = 1; i < count; i++) {
        const struct member member = members[i];
        size_t at = i;
        for (; at > 0 && members[at - 1].key > member.key; at--)
            members[at] = members[at - 1];
        members[at] = member;
    }
}

/* Context for making a level. */
struct building {
    const struct kiln_merge_grid *grid;
    const struct member *all;
    struct level *level;
    struct member *sorted; /* those of the level by slot, then by key */
    uint32_t *slot;        /* per member */
    uint32_t *bin_of;      /* per member: its range of slots; the number of ranges: nobody looks there */
    bool *looked_at;       /* per slot: whether a point of the level looks there */
    struct kiln_bins bins; /* members by stretches of slots */
    int shift;             /* 2^shift slots are a stretch */
};

/* Sorts the members of one range of slots into their slots. Within a slot they are sorted by key, so that all ranks see
 * the members of a cell in the same order. */
static void fill_stretch(const struct building *b, size_t stretch)
{
    struct level *level = b->level;
    const size_t first = stretch << b->shift, end = (stretch + 1) << b->shift;
    const uint32_t *order = b->bins.order, begin = b->bins.begin[stretch], stop = b->bins.begin[stretch + 1];
    for (uint32_t i = begin; i < stop; i++)
        level->begin[b->slot[order[i]] + 1]++;
    size_t next = begin; /* turns the number of members before a slot into the index of its next member */
    for (size_t slot = first; slot < end; slot++) {
        const size_t count = level->begin[slot + 1];
        level->begin[slot + 1] = next;
        next += count;
    }
    for (uint32_t i = begin; i < stop; i++) {
        b->sorted[level->begin[b->slot[order[i]] + 1]++] = b->all[order[i]];
    }
    for (size_t slot = first, from = begin; slot < end; from = level->begin[++slot])
        sort_by_key(b->sorted + from, level->begin[slot + 1] - from);
    for (size_t i = begin; i < stop; i++) {
        const struct kiln_vec3 p = b->grid->places[b->sorted[i].at].position;
        level->at[i] = b->sorted[i].at;
        level->tag[i] = tag_of(cell_of(level, p));
        level->position[X][i] = p.x;
        level->position[Y][i] = p.y;
        level->position[Z][i] = p.z;
    }
}

/* Marks the slots that points of the level look at: other members are of no use there. After the fit of radii most
 * levels have few points. */
static void mark_slots(const struct building *b, size_t count, uint32_t threads)
{
    const struct kiln_merge_grid *grid = b->grid;
    memset(b->looked_at, 0, grid->slots * sizeof *b->looked_at);
#pragma omp parallel for num_threads((int)threads) schedule(static)
    for (size_t i = 0; i < count; i++) {
        const struct kiln_merge_place *place = &grid->places[b->all[i].at];
        struct cell cells[NEIGHBOUR_CELLS];
        if (&grid->levels[grid->level[b->all[i].at]] != b->level)
            continue;
        const size_t near = find_cells(grid, b->level, place->position, fminf(grid->radius, place->widest), cells);
        for (size_t c = 0; c < near; c++) {
#pragma omp atomic write
            b->looked_at[cells[c].slot] = true;
        }
    }
}

static int make_columns(struct level *level, size_t count, struct kiln_error *error)
{
    const char *what = "the grid of merged points";
    int status;
    KILN_TRY(kiln_allocate_bare(&level->at, count, sizeof *level->at, what, error));
    KILN_TRY(kiln_allocate_bare(&level->tag, count, sizeof *level->tag, what, error));
    KILN_TRY(kiln_allocate_bare(&level->position[X], count * AXES, sizeof(float), what, error));
    level->position[Y] = level->position[X] + count;
    level->position[Z] = level->position[Y] + count;
end:
    return status;
}

static int build_level(struct building *b, size_t count, uint32_t threads, struct kiln_error *error)
{
    const struct kiln_merge_grid *grid = b->grid;
    const size_t stretches = grid->slots >> b->shift;
    int status;
    KILN_TRY(
        kiln_allocate(&b->level->begin, grid->slots + 1, sizeof *b->level->begin, "the grid of merged points", error));
    mark_slots(b, count, threads);
#pragma omp parallel for num_threads((int)threads) schedule(static)
    for (size_t i = 0; i < count; i++) {
        const size_t slot = slot_of(grid, cell_of(b->level, grid->places[b->all[i].at].position));
        b->slot[i] = (uint32_t)slot;
        b->bin_of[i] = (uint32_t)(b->looked_at[slot] ? slot >> b->shift : stretches);
    }
    KILN_TRY(kiln_bins_sort(&b->bins, b->bin_of, count, stretches + 1, threads, error));
    KILN_TRY(make_columns(b->level, b->bins.begin[stretches], error));
#pragma omp parallel for num_threads((int)threads) schedule(dynamic, 4)
    for (size_t stretch = 0; stretch < stretches; stretch++)
        fill_stretch(b, stretch);
end:
    return status;
}

/* Allocates what building needs, and the levels of places. */
static int make_room(struct building *b, struct kiln_merge_grid *grid, struct member **members, size_t count,
                     struct kiln_error *error)
{
    const char *what = "the grid of merged points";
    int status;
    KILN_TRY(kiln_allocate_bare(members, count, sizeof **members, what, error));
    KILN_TRY(kiln_allocate_bare(&b->sorted, count, sizeof *b->sorted, what, error));
    KILN_TRY(kiln_allocate_bare(&b->slot, count, sizeof *b->slot, what, error));
    KILN_TRY(kiln_allocate_bare(&b->bin_of, count, sizeof *b->bin_of, what, error));
    KILN_TRY(kiln_allocate_bare(&b->looked_at, grid->slots, sizeof *b->looked_at, what, error));
    KILN_TRY(kiln_allocate(&grid->level, count, sizeof *grid->level, what, error));
end:
    return status;
}

int kiln_merge_grid_create(struct kiln_merge_grid **grid, const struct kiln_merge_place *places, size_t count,
                           float radius, uint32_t threads, struct kiln_error *error)
{
    struct building building = {.shift = 0};
    struct member *members = NULL;
    uint32_t wanted = 0; /* a bit a level */
    int status = kiln_allocate(grid, 1, sizeof **grid, "the grid of merged points", error);
    if (status != KILN_OK)
        return status;
    struct kiln_merge_grid *made = *grid;
    *made = (struct kiln_merge_grid){.places = places, .radius = radius, .slots = 1};
    while (made->slots < count / POINTS_A_SLOT)
        made->slots *= 2;
    while (made->slots >> building.shift > STRETCHES_MOST)
        building.shift++;
    status = make_room(&building, made, &members, count, error);
    const size_t taking_part = status == KILN_OK ? list_members(places, count, members) : 0;
#pragma omp parallel for num_threads((int)threads) schedule(static) reduction(| : wanted)
    for (size_t i = 0; i < taking_part; i++) {
        const size_t at = members[i].at;
        made->level[at] = (uint8_t)kiln_merge_grid_level(made, places[at].widest);
        wanted |= 1u << made->level[at];
    }
    building.grid = made;
    building.all = members;
    for (int l = 0; l < LEVELS && status == KILN_OK; l++) {
        building.level = &made->levels[l];
        building.level->side = (double)SLACK * (double)ldexpf(radius, -l);
        if ((wanted >> l & 1u) != 0)
            status = build_level(&building, taking_part, threads, error);
    }
    kiln_free(&members);
    kiln_free(&building.sorted);
    kiln_free(&building.slot);
    kiln_free(&building.bin_of);
    kiln_free(&building.looked_at);
    kiln_bins_release(&building.bins);
    return status;
}

void kiln_merge_grid_destroy(struct kiln_merge_grid **grid)
{
    if (*grid == NULL)
        return;
    for (int l = 0; l < LEVELS; l++) {
        kiln_free(&(*grid)->levels[l].begin);
        kiln_free(&(*grid)->levels[l].at);
        kiln_free(&(*grid)->levels[l].tag);
        kiln_free(&(*grid)->levels[l].position[X]);
    }
    kiln_free(&(*grid)->level);
    kiln_free(grid);
}

/* ---- search ---- */

int kiln_merge_grid_level_of(const struct kiln_merge_grid *grid, size_t at) { return grid->level[at]; }

double kiln_merge_grid_side(const struct kiln_merge_grid *grid, int level) { return grid->levels[level].side; }

void kiln_merge_grid_cell(const struct kiln_merge_grid *grid, int level, struct kiln_vec3 p, int64_t cell[3])
{
    cell[0] = cell_along(&grid->levels[level], p.x);
    cell[1] = cell_along(&grid->levels[level], p.y);
    cell[2] = cell_along(&grid->levels[level], p.z);
}

/* Squared distance of a place from a box, without a branch: places inside and outside alternate. */
static float far_from(const struct kiln_merge_box *box, struct kiln_vec3 p)
{
    const float to_x = box->low.x - p.x, to_y = box->low.y - p.y, to_z = box->low.z - p.z, from_x = p.x - box->high.x,
                from_y = p.y - box->high.y, from_z = p.z - box->high.z, /* and 0, or twice the distance: */
        x = to_x + fabsf(to_x) + (from_x + fabsf(from_x)), y = to_y + fabsf(to_y) + (from_y + fabsf(from_y)),
                z = to_z + fabsf(to_z) + (from_z + fabsf(from_z));
    return 0.25f * (x * x + y * y + z * z);
}

/* Finds which of some points lie in a cell and within a distance of the box. A byte of each is 1 where it does. */
KILN_CLONES static void look(const struct level *level, size_t first, size_t count, uint32_t tag,
                             const struct kiln_merge_box *box, float far, uint8_t is_near[LANES])
{
    const float *const x = level->position[X] + first, *const y = level->position[Y] + first,
                       *const z = level->position[Z] + first;
    const uint32_t *const tags = level->tag + first;
    const struct kiln_merge_box of = *box;
#pragma omp simd
    for (size_t i = 0; i < count; i++)
        is_near[i] =
            (uint8_t)((uint32_t)(tags[i] == tag) & (uint32_t)(far_from(&of, vec3(x[i], y[i], z[i])) <= far * far));
}

/* Adds the points of a cell that lie within the box's radius of it. No branch hangs on a point: half of them do. */
static int add_cell(const struct kiln_merge_grid *grid, const struct level *level, uint64_t cell,
                    const struct kiln_merge_box *box, struct kiln_merge_candidates *found, struct kiln_error *error)
{
    const size_t slot = slot_of(grid, cell), begin = level->begin[slot], end = level->begin[slot + 1];
    uint8_t is_near[LANES];
    const int status =
        kiln_grow(&found->of, &found->room, found->count + (end - begin), sizeof *found->of, "points nearby", error);
    for (size_t first = begin; first < end && status == KILN_OK; first += LANES) {
        const size_t count = end - first < LANES ? end - first : LANES;
        look(level, first, count, tag_of(cell), box, (float)BEYOND * box->radius, is_near);
        for (size_t i = 0; i < count; i++) {
            found->of[found->count] = level->at[first + i];
            found->count += is_near[i];
        }
    }
    return status;
}

/* Leaves out points that do not look so far as to the box. */
static void keep_wide(const struct kiln_merge_place *places, const struct kiln_merge_box *box,
                      struct kiln_merge_candidates *found)
{
    size_t kept = 0;
    for (size_t i = 0; i < found->count; i++) {
        const struct kiln_merge_place *place = &places[found->of[i]];
        const float least = (float)BEYOND * place->widest;
        found->of[kept] = found->of[i];
        kept += (size_t)(least > 0.0f) & (size_t)(far_from(box, place->position) <= least * least);
    }
    found->count = kept;
}

int kiln_merge_grid_find(const struct kiln_merge_grid *grid, int level, const struct kiln_merge_box *box,
                         struct kiln_merge_candidates *found, struct kiln_error *error)
{
    const float wide = (float)BEYOND * box->radius;
    const struct kiln_vec3 margin = vec3(wide, wide, wide);
    int64_t first[3], last[3];
    int status = KILN_OK;
    found->count = 0;
    if (grid->levels[level].begin == NULL)
        return KILN_OK;
    kiln_merge_grid_cell(grid, level, vec3_sub(box->low, margin), first);
    kiln_merge_grid_cell(grid, level, vec3_add(box->high, margin), last);
    for (int64_t z = first[2]; z <= last[2]; z++)
        for (int64_t y = first[1]; y <= last[1]; y++)
            for (int64_t x = first[0]; x <= last[0] && status == KILN_OK; x++)
                status = add_cell(grid, &grid->levels[level], cell_word(x, y, z), box, found, error);
    keep_wide(grid->places, box, found);
    return status;
}
