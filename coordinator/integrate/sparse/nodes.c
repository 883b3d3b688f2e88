#include "coordinator/integrate/sparse/nodes.h"

#include <math.h>

#include "coordinator/integrate/sparse/blocks.h"
#include "worker/base/memory.h"

/* Layout of a packed mixture: 16 bits per node, for its place and its weight. Weights are in steps that add up to
 * WEIGHTS. */
enum { PLACE_BITS = 6, WEIGHTS = 1023, NODE_BITS = 16 };
/* Ridge regularization of the nodes' second moments, as a weight one texel away. It is needed where nodes lie on a
 * line, since nothing is known across it. */
static const double RIDGE = 1e-3;

/* ---- packing ---- */

static uint64_t pack(const struct kiln_mixture *m)
{
    uint32_t steps[KILN_MIXED_MOST] = {0}, sum = 0, most = 0;
    uint64_t packed = 0;
    for (uint32_t i = 0; i < m->count; i++) {
        steps[i] = (uint32_t)(m->weight[i] * WEIGHTS);
        sum += steps[i];
        most = m->weight[i] > m->weight[most] ? i : most;
    }
    steps[most] += WEIGHTS - sum;
    for (uint32_t i = 0; i < m->count; i++)
        packed |= (uint64_t)(m->place[i] | steps[i] << PLACE_BITS) << NODE_BITS * i;
    return packed;
}

static void unpack(uint64_t packed, struct kiln_mixture *mixture)
{
    mixture->count = 0;
    for (; packed != 0; packed >>= NODE_BITS) {
        const uint32_t steps = packed >> PLACE_BITS & WEIGHTS;
        if (steps == 0)
            continue;
        mixture->place[mixture->count] = packed & (KILN_TILE_TEXELS - 1);
        mixture->weight[mixture->count++] = (double)steps / WEIGHTS;
    }
}

static uint64_t alone(uint32_t place) { return place | (uint64_t)WEIGHTS << PLACE_BITS; }

void kiln_nodes_draw(struct kiln_sparse *sparse, const struct kiln_surface *surface, const struct kiln_tile_run *run,
                     const uint64_t *mixtures)
{
    struct kiln_own_point own = kiln_own_of_global(surface, run->first);
    sparse->selection = (struct kiln_selection){0};
    for (uint32_t k = 0; k < run->count; k++, own.at++) {
        unpack(mixtures[k], &sparse->mixture[k]);
        if (mixtures[k] == alone(k) && kiln_point_valid(surface, own))
            sparse->selection.computed |= 1ull << k;
    }
}

/* ---- mixtures ---- */

/* A block: its texels, its anchors, and the blocks that go on from it (kiln_blocks_find). */
struct block {
    int low[2], high[2];
    uint64_t nodes, links;
};

/* A tile run. */
struct tile {
    const struct kiln_tile_run *run;
    const uint16_t *block;                 /* of its points */
    int at[KILN_TILE_TEXELS][2];           /* texel of its points */
    struct block blocks[KILN_TILE_TEXELS]; /* indexed by the place of a block's first point */
};

static double square(double x) { return x * x; }

static double away(const struct tile *t, uint32_t a, uint32_t b)
{
    return square((double)(t->at[a][0] - t->at[b][0])) + square((double)(t->at[a][1] - t->at[b][1]));
}

static void begin(struct tile *t, const struct kiln_tile_run *run, const uint16_t *block, const uint64_t *links)
{
    t->run = run;
    t->block = block;
    uint64_t rest = run->mask;
    for (uint32_t k = 0; k < run->count; k++, rest &= rest - 1) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        struct block *b = &t->blocks[block[k]];
        t->at[k][0] = (int)kiln_morton8_x(bit);
        t->at[k][1] = (int)kiln_morton8_y(bit);
        if (block[k] == k)
            *b = (struct block){{t->at[k][0], t->at[k][1]}, {t->at[k][0], t->at[k][1]}, 0, links[k]};
        for (int i = 0; i < 2; i++) {
            b->low[i] = t->at[k][i] < b->low[i] ? t->at[k][i] : b->low[i];
            b->high[i] = t->at[k][i] > b->high[i] ? t->at[k][i] : b->high[i];
        }
    }
}

/* Whether another block continues a block beyond its own texels in the direction `sign` of an axis. */
static bool goes_on(const struct tile *t, const struct block *b, int axis, int sign)
{
    for (uint64_t rest = b->links; rest != 0; rest &= rest - 1) {
        const struct block *other = &t->blocks[__builtin_ctzll(rest)];
        if (sign > 0 ? other->low[axis] > b->high[axis] : other->high[axis] < b->low[axis])
            return true;
    }
    return false;
}

/* The point of a block that lies farthest in a diagonal direction. */
static uint32_t farthest(const struct tile *t, uint32_t first, int x, int y)
{
    uint32_t best = first;
    for (uint32_t k = first; k < t->run->count; k++)
        if (t->block[k] == first && x * t->at[k][0] + y * t->at[k][1] > x * t->at[best][0] + y * t->at[best][1])
            best = k;
    return best;
}

/* Chooses the nodes of each block: the corners beyond which no block continues it. If it continues on all sides, the
 * corner farthest from the tile's middle. */
static void choose_nodes(struct tile *t, const uint8_t corner[KILN_TILE_TEXELS])
{
    for (uint32_t k = 0; k < t->run->count; k++) {
        struct block *b = &t->blocks[k];
        if (t->block[k] != k)
            continue;
        for (int x = -1; x <= 1; x += 2)
            for (int y = -1; y <= 1; y += 2)
                if (!goes_on(t, b, 0, x) && !goes_on(t, b, 1, y))
                    b->nodes |= 1ull << farthest(t, k, x, y);
        if (b->nodes == 0)
            b->nodes = 1ull << corner[k];
    }
}

/* Chooses the nodes of point p: the nearest ones of its block and of the linked blocks. */
static void choose(const struct tile *t, uint32_t p, struct kiln_mixture *m)
{
    const struct block *b = &t->blocks[t->block[p]];
    uint64_t nodes = b->nodes;
    for (uint64_t rest = b->links; rest != 0; rest &= rest - 1)
        nodes |= t->blocks[__builtin_ctzll(rest)].nodes;
    m->count = 0;
    for (; nodes != 0; nodes &= nodes - 1) {
        const uint8_t node = (uint8_t)__builtin_ctzll(nodes);
        uint32_t i = m->count < KILN_MIXED_MOST ? m->count++ : KILN_MIXED_MOST;
        for (; i > 0 && away(t, m->place[i - 1], p) > away(t, node, p); i--)
            if (i < KILN_MIXED_MOST)
                m->place[i] = m->place[i - 1];
        if (i < KILN_MIXED_MOST)
            m->place[i] = node;
    }
}

/* Computes the weights of point p's nodes by moving least squares: the value of the best linear fit at p, up to a
 * common factor. */
static void weigh(const struct tile *t, uint32_t p, struct kiln_mixture *m)
{
    double x = 0.0, y = 0.0, xx = RIDGE, xy = 0.0, yy = RIDGE;
    double weight[KILN_MIXED_MOST], dx[KILN_MIXED_MOST], dy[KILN_MIXED_MOST];
    for (uint32_t i = 0; i < m->count; i++) {
        weight[i] = 1.0 / away(t, m->place[i], p);
        dx[i] = (double)(t->at[m->place[i]][0] - t->at[p][0]);
        dy[i] = (double)(t->at[m->place[i]][1] - t->at[p][1]);
        x += weight[i] * dx[i];
        y += weight[i] * dy[i];
        xx += weight[i] * dx[i] * dx[i];
        xy += weight[i] * dx[i] * dy[i];
        yy += weight[i] * dy[i] * dy[i];
    }
    /* first column of the adjugate of the normal equations' matrix */
    const double c0 = xx * yy - xy * xy, c1 = xy * y - x * yy, c2 = x * xy - xx * y;
    for (uint32_t i = 0; i < m->count; i++)
        m->weight[i] = weight[i] * (c0 + c1 * dx[i] + c2 * dy[i]);
}

/* Removes the node with the most negative weight. Returns false if no weight is negative. */
static bool leave_out(struct kiln_mixture *m)
{
    uint32_t least = 0;
    for (uint32_t i = 1; i < m->count; i++)
        least = m->weight[i] < m->weight[least] ? i : least;
    if (m->count < 2 || m->weight[least] >= 0.0)
        return false;
    m->count--;
    for (uint32_t i = least; i < m->count; i++)
        m->place[i] = m->place[i + 1];
    return true;
}

static void normalise(struct kiln_mixture *m)
{
    double sum = 0.0;
    for (uint32_t i = 0; i < m->count; i++)
        sum += m->weight[i];
    for (uint32_t i = 0; i < m->count; i++)
        m->weight[i] /= sum;
}

static uint64_t mix(const struct tile *t, uint32_t p)
{
    struct kiln_mixture m;
    if ((t->blocks[t->block[p]].nodes >> p & 1u) != 0)
        return alone(p);
    choose(t, p, &m);
    do
        weigh(t, p, &m);
    while (leave_out(&m));
    normalise(&m);
    return pack(&m);
}

/* Replaces the links in `mixtures`, which begins at the tile run's first point, by the points' mixtures. */
static void mix_all(const struct kiln_tile_run *run, const uint16_t *block, uint64_t *mixtures)
{
    struct tile tile;
    uint8_t corner[KILN_TILE_TEXELS];
    begin(&tile, run, block, mixtures);
    kiln_block_corners(run, block, corner);
    choose_nodes(&tile, corner);
    for (uint32_t k = 0; k < run->count; k++)
        mixtures[k] = mix(&tile, k);
}

int kiln_anchors_find(const struct kiln_surface *surface, struct kiln_backend *backend, uint32_t threads,
                      uint32_t scale, uint64_t *mixtures, struct kiln_error *error)
{
    uint16_t *block = NULL;
    int status = kiln_allocate(&block, surface->count, sizeof *block, "the blocks of points", error);
    if (status == KILN_OK)
        status = kiln_blocks_find(surface, backend, threads, scale, block, mixtures, error);
#pragma omp parallel for schedule(dynamic, 8) num_threads((int)threads)
    for (size_t f = 0; f < surface->tile_run_count; f++) {
        const uint64_t own = kiln_own_of_global(surface, surface->tile_runs[f].first).at;
        if (status == KILN_OK)
            mix_all(&surface->tile_runs[f], block + own, mixtures + own);
    }
    kiln_free(&block);
    return status;
}
