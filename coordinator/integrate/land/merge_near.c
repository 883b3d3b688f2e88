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

/* A point in its cell. */
struct member {
    uint64_t cell;
    size_t at;
};

/* Values compared for all points of a cell, copied here: most are too far. */
enum column { X, Y, Z, NORMAL_X, NORMAL_Y, NORMAL_Z, WIDEST, COLUMNS };

/* A hash table of cells: members[begin[h] .. begin[h + 1]) have the hash h. Without members no point uses the level. */
struct level {
    double side; /* m, of a cell */
    size_t *begin;
    struct member *members;
    float *columns[COLUMNS]; /* by member; the first is the block */
};

struct kiln_merge_grid {
    const struct kiln_merge_place *places;
    float radius;
    size_t slots; /* a power of two */
    struct level levels[LEVELS];
};

/* The level whose cells are as wide as the point looks, or less than twice as wide. */
static int level_of(const struct kiln_merge_grid *grid, const struct kiln_merge_place *place)
{
    int level = 0;
    while (level + 1 < LEVELS && place->widest <= ldexpf(grid->radius, -level - 1))
        level++;
    return level;
}

static int64_t cell_along(const struct level *level, float x)
{
    const double most_cells = 0x1p60;
    return (int64_t)fmax(-most_cells, fmin(floor((double)x / level->side), most_cells));
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
            members[taking_part++] = (struct member){places[i].key, i};
    return taking_part;
}

static int by_key(const void *a, const void *b)
{
    const struct member *one = a, *other = b; /* the key is where the cell will be */
    return (one->cell > other->cell) - (one->cell < other->cell);
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
        for (; at > 0 && members[at - 1].cell > member.cell; at--)
            members[at] = members[at - 1];
        members[at] = member;
    }
}

/* Context for making a level. */
struct building {
    const struct kiln_merge_grid *grid;
    const struct member *all;
    struct level *level;
    uint32_t *bin_of;      /* per member: its range of slots; the number of ranges: nobody looks there */
    bool *looked_at;       /* per slot: whether a point of the level looks there */
    struct kiln_bins bins; /* members by stretches of slots */
    int shift;             /* 2^shift slots are a stretch */
};

static size_t slot_for(const struct building *b, const struct member *member)
{
    return slot_of(b->grid, cell_of(b->level, b->grid->places[member->at].position));
}

/* Sorts the members of one range of slots into their slots. Within a slot they are sorted by key, so that all ranks see
 * the members of a cell in the same order. */
static void fill_stretch(const struct building *b, size_t stretch)
{
    struct level *level = b->level;
    const size_t first = stretch << b->shift, end = (stretch + 1) << b->shift;
    const uint32_t *order = b->bins.order, begin = b->bins.begin[stretch], stop = b->bins.begin[stretch + 1];
    for (uint32_t i = begin; i < stop; i++)
        level->begin[slot_for(b, &b->all[order[i]]) + 1]++;
    size_t next = begin; /* turns the number of members before a slot into the index of its next member */
    for (size_t slot = first; slot < end; slot++) {
        const size_t count = level->begin[slot + 1];
        level->begin[slot + 1] = next;
        next += count;
    }
    for (uint32_t i = begin; i < stop; i++) {
        const struct member *member = &b->all[order[i]];
        level->members[level->begin[slot_for(b, member) + 1]++] = *member;
    }
    for (size_t slot = first, from = begin; slot < end; from = level->begin[++slot])
        sort_by_key(level->members + from, level->begin[slot + 1] - from);
    for (size_t i = begin; i < stop; i++) {
        const struct kiln_merge_place *place = &b->grid->places[level->members[i].at];
        const struct kiln_vec3 p = place->position, n = place->normal;
        const float values[COLUMNS] = {p.x, p.y, p.z, n.x, n.y, n.z, place->widest};
        level->members[i].cell = cell_of(level, p);
        for (int c = 0; c < COLUMNS; c++)
            level->columns[c][i] = values[c];
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
        if (&grid->levels[level_of(grid, place)] != b->level)
            continue;
        const size_t near = find_cells(grid, b->level, place->position, fminf(grid->radius, place->widest), cells);
        for (size_t c = 0; c < near; c++) {
#pragma omp atomic write
            b->looked_at[cells[c].slot] = true;
        }
    }
}

static int make_room(struct level *level, size_t count, struct kiln_error *error)
{
    int status = kiln_allocate_bare(&level->members, count, sizeof *level->members, "the grid of merged points", error);
    if (status == KILN_OK)
        status =
            kiln_allocate_bare(&level->columns[0], count * COLUMNS, sizeof(float), "the grid of merged points", error);
    for (int c = 1; c < COLUMNS && status == KILN_OK; c++)
        level->columns[c] = level->columns[0] + (size_t)c * count;
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
        const size_t slot = slot_for(b, &b->all[i]);
        b->bin_of[i] = (uint32_t)(b->looked_at[slot] ? slot >> b->shift : stretches);
    }
    KILN_TRY(kiln_bins_sort(&b->bins, b->bin_of, count, stretches + 1, threads, error));
    KILN_TRY(make_room(b->level, b->bins.begin[stretches], error));
#pragma omp parallel for num_threads((int)threads) schedule(dynamic, 4)
    for (size_t stretch = 0; stretch < stretches; stretch++)
        fill_stretch(b, stretch);
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
    **grid = (struct kiln_merge_grid){.places = places, .radius = radius, .slots = 1};
    while ((*grid)->slots < count / POINTS_A_SLOT)
        (*grid)->slots *= 2;
    while ((*grid)->slots >> building.shift > STRETCHES_MOST)
        building.shift++;
    status = kiln_allocate_bare(&members, count, sizeof *members, "the grid of merged points", error);
    if (status == KILN_OK)
        status =
            kiln_allocate_bare(&building.bin_of, count, sizeof *building.bin_of, "the grid of merged points", error);
    if (status == KILN_OK)
        status = kiln_allocate_bare(&building.looked_at, (*grid)->slots, sizeof *building.looked_at,
                                    "the grid of merged points", error);
    const size_t taking_part = status == KILN_OK ? list_members(places, count, members) : 0;
    const struct kiln_merge_grid *made = *grid;
#pragma omp parallel for num_threads((int)threads) schedule(static) reduction(| : wanted)
    for (size_t i = 0; i < taking_part; i++)
        wanted |= 1u << level_of(made, &places[members[i].at]);
    building.grid = made;
    building.all = members;
    for (int l = 0; l < LEVELS && status == KILN_OK; l++) {
        building.level = &(*grid)->levels[l];
        building.level->side = (double)SLACK * (double)ldexpf(radius, -l);
        if ((wanted >> l & 1u) != 0)
            status = build_level(&building, taking_part, threads, error);
    }
    kiln_free(&members);
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
        kiln_free(&(*grid)->levels[l].members);
        kiln_free(&(*grid)->levels[l].columns[0]);
    }
    kiln_free(grid);
}

/* Tests members from `first` on against a place, several at once in SIMD lanes, as kiln_merge_are_near does. A byte of
 * each is 1 where it is near. */
KILN_CLONES static void look(const struct level *level, size_t first, size_t count,
                             const struct kiln_merge_place *place, float radius, uint8_t near[LANES])
{
    const float *const x = level->columns[X] + first, *const y = level->columns[Y] + first,
                       *const z = level->columns[Z] + first, *const nx = level->columns[NORMAL_X] + first,
                       *const ny = level->columns[NORMAL_Y] + first, *const nz = level->columns[NORMAL_Z] + first,
                       *const widest = level->columns[WIDEST] + first;
    const struct kiln_vec3 p = place->position, n = place->normal;
#pragma omp simd
    for (size_t i = 0; i < count; i++) {
        const float least = radius < widest[i] ? radius : widest[i], flat = KILN_MERGE_FLAT * least, dx = x[i] - p.x,
                    dy = y[i] - p.y, dz = z[i] - p.z, below = fabsf(dx * n.x + dy * n.y + dz * n.z),
                    above = fabsf(dx * nx[i] + dy * ny[i] + dz * nz[i]);
        near[i] = (uint8_t)((uint32_t)(dx * dx + dy * dy + dz * dz <= least * least) &
                            (uint32_t)(n.x * nx[i] + n.y * ny[i] + n.z * nz[i] >= KILN_MERGE_ALIKE) &
                            (uint32_t)(below <= flat) & (uint32_t)(above <= flat));
    }
}

/* Adds the points of a cell that are near point `at`, but for itself. */
static int add_near(const struct kiln_merge_grid *grid, const struct level *level, size_t at, struct cell cell,
                    float radius, struct kiln_merge_near *near, struct kiln_error *error)
{
    const size_t begin = level->begin[cell.slot], end = level->begin[cell.slot + 1];
    union {
        uint8_t of[LANES];
        uint64_t eight[LANES / 8];
    } is_near;
    const int status =
        kiln_grow(&near->of, &near->room, near->count + (end - begin), sizeof *near->of, "points nearby", error);
    for (size_t first = begin; first < end && status == KILN_OK; first += LANES) {
        const size_t count = end - first < LANES ? end - first : LANES;
        is_near.eight[(count - 1) / 8] = 0; /* those beyond the last are not */
        look(level, first, count, &grid->places[at], radius, is_near.of);
        for (size_t word = 0; 8 * word < count; word++)
            for (uint64_t rest = is_near.eight[word]; rest != 0; rest &= rest - 1) {
                const struct member *member = &level->members[first + 8 * word + (size_t)__builtin_ctzll(rest) / 8];
                if (member->cell == cell.word && member->at != at)
                    near->of[near->count++] = member->at;
            }
    }
    return status;
}

int kiln_merge_grid_find(const struct kiln_merge_grid *grid, size_t at, float radius, struct kiln_merge_near *near,
                         struct kiln_error *error)
{
    struct cell cells[NEIGHBOUR_CELLS];
    int status = kiln_grow(&near->of, &near->room, 1, sizeof *near->of, "points nearby", error);
    if (status != KILN_OK)
        return status;
    near->of[0] = at;
    near->count = 1;
    if (grid == NULL || !(radius > 0.0f))
        return KILN_OK;
    const struct level *level = &grid->levels[level_of(grid, &grid->places[at])];
    const size_t count = find_cells(grid, level, grid->places[at].position, radius, cells);
    for (size_t i = 0; i < count; i++)
        __builtin_prefetch(&level->begin[cells[i].slot]);
    for (size_t i = 0; i < count && status == KILN_OK; i++)
        status = add_near(grid, level, at, cells[i], radius, near, error);
    return status;
}

/* ---- sets ---- */

size_t kiln_merge_grid_slots(const struct kiln_merge_grid *grid) { return grid->slots; }

void kiln_merge_grid_mark(const struct kiln_merge_grid *grid, size_t at, uint8_t *set)
{
    const size_t slot = slot_of(grid, cell_of(&grid->levels[0], grid->places[at].position));
#pragma omp atomic write
    set[slot] = 1;
}

bool kiln_merge_grid_marked(const struct kiln_merge_grid *grid, size_t at, const uint8_t *set)
{
    struct cell cells[NEIGHBOUR_CELLS];
    const size_t count = find_cells(grid, &grid->levels[0], grid->places[at].position, grid->radius, cells);
    bool marked = false;
    for (size_t i = 0; i < count; i++)
        marked = marked || set[cells[i].slot] != 0;
    return marked;
}
