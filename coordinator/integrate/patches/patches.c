#include "coordinator/integrate/patches/patches.h"

#include <limits.h>
#include <math.h>
#include <string.h>

#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/patches/directions.h"
#include "coordinator/integrate/land/land.h"
#include "coordinator/integrate/patches/link_rooms.h"
#include "coordinator/integrate/patches/links.h"
#include "coordinator/integrate/packing.h"
#include "coordinator/integrate/patches/senders.h"
#include "coordinator/mpi/agree.h"
#include "worker/backend/extended.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"
#include "worker/pass/shapes.h"
#include "worker/sampling/keys.h"
#include "worker/scene/radiosity.h"

#define KILN_NODE_ALIKE 0.9063f /* cosine of 25 degrees, as of blocks (blocks.h) */
/* Clamps as in Kahl 2023, section 4.7.3, which gives no values. */
#define KILN_CLAMP_FACTOR 1.0
#define KILN_CLAMP_ADDED 0.05 /* W/m2 */

/* Random stream of the rays that complete rows of links. It is the same for all bounces, so it does not matter in which
 * bounce links are found. */
enum { KILN_LINKS_STREAM = 1 };

struct kiln_patches {
    struct kiln_patches_source source;
    /* input of the present update: packed radiosity of all points, and the step */
    const uint64_t *radiosity;
    const struct kiln_step *step;
    struct kiln_patch *points; /* of all surface points; NULL: not found yet */
    float (*emission)[3];      /* emission of all points, W/m2; NULL: emitters are sampled instead */
    struct kiln_patch_node *nodes;
    double level; /* radiosity that deviations are relative to, W/m2 */
    struct kiln_patches_parameters parameters, of_round;
    uint32_t *rooms;                     /* room of each point, for links; NULL: not found yet */
    struct kiln_links *links;            /* NULL: not found yet, or there are none */
    bool links_of_emission;              /* made for what is emitted */
    struct kiln_visibility_cache *cache; /* NULL: none */
    struct kiln_voxels *voxels;          /* NULL: rays say what patches see */
    struct kiln_senders *senders;        /* NULL: all nodes send in every step */
    struct kiln_directions *directions;  /* clusters of points, used instead of nodes; NULL: not made yet */
};

int kiln_patches_create(struct kiln_patches **patches, const struct kiln_patches_source *source,
                        struct kiln_error *error)
{
    struct kiln_patches *p = NULL;
    const int status = kiln_allocate(&p, 1, sizeof *p, "the patches", error);
    if (status == KILN_OK)
        p->source = *source;
    *patches = p;
    return status;
}

void kiln_patches_destroy(struct kiln_patches **patches)
{
    if (*patches == NULL)
        return;
    kiln_free(&(*patches)->points);
    kiln_free(&(*patches)->emission);
    kiln_free(&(*patches)->nodes);
    kiln_links_destroy(&(*patches)->links);
    kiln_free(&(*patches)->rooms);
    kiln_voxels_destroy(&(*patches)->voxels);
    kiln_senders_destroy(&(*patches)->senders);
    kiln_directions_destroy(&(*patches)->directions);
    kiln_visibility_cache_destroy(&(*patches)->cache);
    kiln_free(patches);
}

static uint64_t cache_bytes(const struct kiln_patch_settings *settings)
{
    return (uint64_t)(settings->visibility_cache * 0x1p30);
}

static bool has_pairs(const struct kiln_patch_settings *settings)
{
    return settings->gather == KILN_GATHER_PAIRS && settings->patches == KILN_PATCHES_ALL;
}

/* Whether the settings need the shapes of points. */
static bool needs_shapes(const struct kiln_patch_settings *settings)
{
    return settings->gather == KILN_GATHER_PAIRS || settings->gather == KILN_GATHER_MIXED ||
           settings->lights == KILN_LIGHTS_PATCHES;
}

/* Size of the voxel grid, bytes; 0: no grid. */
static uint64_t grid_bytes(const struct kiln_patch_settings *settings)
{
    return settings->visibility == KILN_VISIBILITY_VOXELS ? kiln_voxels_bytes(settings->voxels) : 0;
}

uint64_t kiln_patches_device_bytes(const struct kiln_patch_settings *settings, uint64_t own, uint64_t points)
{
    const uint64_t most = cache_bytes(settings);
    return !has_pairs(settings)
               ? 0
               : grid_bytes(settings) + (most > 0 ? kiln_visibility_device_bytes(most, own, points) : 0);
}

uint64_t kiln_patches_bytes(const struct kiln_patch_settings *settings, uint64_t own, uint64_t points, bool device)
{
    const uint64_t emission = settings->lights == KILN_LIGHTS_PATCHES ? 3 * sizeof(float) : 0,
                   most = cache_bytes(settings);
    if (settings->patches == KILN_PATCHES_LINKS)
        return points * (sizeof(struct kiln_patch) + emission) +
               kiln_links_bytes_expected(points, own, settings->link_error);
    if (settings->gather != KILN_GATHER_PAIRS)
        return points * (needs_shapes(settings) ? sizeof(struct kiln_patch) + emission : 0) +
               kiln_directions_bytes(settings, points);
    return points * (sizeof(struct kiln_patch) + sizeof(struct kiln_patch_node) + emission) +
           (most > 0 ? kiln_visibility_cache_bytes(device ? 0 : most, own, points) : 0) + grid_bytes(settings) +
           (settings->order == KILN_ORDER_UNSHOT ? kiln_senders_bytes(points) : 0);
}

struct kiln_visibility_counts kiln_patches_visibility(const struct kiln_patches *p)
{
    return p != NULL && p->cache != NULL ? kiln_visibility_cache_count(p->cache) : (struct kiln_visibility_counts){0};
}

void kiln_patches_links(const struct kiln_patches *p, uint64_t *count, uint64_t *bytes)
{
    uint64_t replayed;
    *count = *bytes = 0;
    if (p != NULL && p->links != NULL)
        kiln_links_count(p->links, count, bytes, &replayed);
}

/* Implements kiln_take_results: drops the results, since only links are wanted. */
static int take_nothing(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)context, (void)first, (void)count, (void)results, (void)error;
    return KILN_OK;
}

/* Finds the links of tile runs that were done before an interruption. */
static int find_missing(const struct kiln_patches *p, struct kiln_error *error)
{
    const struct kiln_links_parameters *parameters = p->step->parameters;
    const struct kiln_surface *s = p->source.surface;
    struct kiln_batch batch = {.stream = p->step->stream, .samples = p->step->samples, .take = take_nothing};
    uint64_t rays = 0;
    int status = KILN_OK;
    for (size_t i = 0; i < s->tile_run_count && status == KILN_OK; i += batch.count) {
        const bool missing = parameters->kept[i] == NULL;
        for (batch.first = i, batch.count = 1;
             i + batch.count < s->tile_run_count && (parameters->kept[i + batch.count] == NULL) == missing;)
            batch.count++;
        if (missing)
            status = kiln_backend_run(p->source.backend, &kiln_pass_links, parameters, &batch, &rays, error);
    }
    return status;
}

int kiln_patches_keep(const struct kiln_patches *p, struct kiln_transport *t, struct kiln_error *error)
{
    uint64_t count, bytes, replayed;
    if (!t->of_links || p->links == NULL || p->links_of_emission)
        return KILN_OK;
    const int status = kiln_agree(p->source.communicator, find_missing(p, error), error);
    if (status != KILN_OK)
        return status;
    kiln_links_count(p->links, &count, &bytes, &replayed);
    t->kept = t->replays ? 0 : count;
    t->found = t->replays ? replayed : 0;
    t->traced = t->replays ? count - replayed : 0;
    return t->replays ? KILN_OK : kiln_links_keep(p->links, t, p->source.communicator, error);
}

/* ---- shapes ---- */

/* kiln_take_results */
static int take_shapes(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    struct kiln_patches *p = context;
    const struct kiln_tile_run *run = &p->source.surface->tile_runs[first];
    const struct kiln_shape_result *shapes = results;
    const uint64_t points = kiln_tile_runs_points(run, run + count - 1);
    for (uint64_t i = 0; i < points; i++) {
        p->points[run->first.at + i] = shapes[i].patch;
        if (p->emission != NULL)
            memcpy(p->emission[run->first.at + i], shapes[i].emission, sizeof shapes[i].emission);
    }
    return KILN_OK;
}

/* The point at bit `bit` of a tile. */
static uint64_t point_at(const struct kiln_surface *s, const struct kiln_tile *tile, uint32_t bit)
{
    return kiln_tile_point(s, tile, bit).at;
}

/* Numbers points by lightmap, tile and bit. */
static void number_points(struct kiln_patches *p)
{
    const struct kiln_surface *s = p->source.surface;
    uint32_t number = 0;
    for (uint64_t t = 0; t < s->tile_count; t++)
        for (uint64_t rest = s->tiles[t].mask; rest != 0; rest &= rest - 1)
            p->points[point_at(s, &s->tiles[t], (uint32_t)__builtin_ctzll(rest))].number = number++;
}

/* First point and number of points of each rank. */
struct rank_ranges {
    int *first, *count;
};

static int allocate_rank_ranges(const struct kiln_patches *p, struct rank_ranges *rank_ranges, struct kiln_error *error)
{
    const struct kiln_patches_source *source = &p->source;
    int status = kiln_allocate(&rank_ranges->first, (size_t)source->ranks, sizeof *rank_ranges->first,
                               "the ranks' patches", error);
    if (status == KILN_OK)
        status = kiln_allocate(&rank_ranges->count, (size_t)source->ranks, sizeof *rank_ranges->count,
                               "the ranks' patches", error);
    return status;
}

/* Collective. */
static void gather_rank_ranges(const struct kiln_patches *p, struct rank_ranges *rank_ranges)
{
    const struct kiln_surface *s = p->source.surface;
    const int first = (int)s->first.at, count = (int)s->count;
    (void)MPI_Allgather(&first, 1, MPI_INT, rank_ranges->first, 1, MPI_INT, p->source.communicator);
    (void)MPI_Allgather(&count, 1, MPI_INT, rank_ranges->count, 1, MPI_INT, p->source.communicator);
}

/* Collective. Gathers the values of all ranks on all ranks, `bytes` per point. */
static void share(const struct kiln_patches *p, const struct rank_ranges *rank_ranges, void *values, size_t bytes)
{
    MPI_Datatype value;
    (void)MPI_Type_contiguous((int)bytes, MPI_BYTE, &value);
    (void)MPI_Type_commit(&value);
    (void)MPI_Allgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, values, rank_ranges->count, rank_ranges->first, value,
                         p->source.communicator);
    (void)MPI_Type_free(&value);
}

static bool has_links(const struct kiln_patches *p)
{
    return p->source.settings->patches->patches == KILN_PATCHES_LINKS;
}

static int make_room(struct kiln_patches *p, struct kiln_error *error)
{
    const uint64_t points = p->source.surface->point_count;
    if (points > INT_MAX)
        return kiln_fail(error, KILN_USAGE, "--method radiosity is for %d surface points at most: give --method cells",
                         INT_MAX);
    int status =
        kiln_allocate(&p->points, (size_t)points, sizeof *p->points, "the patches of all surface points", error);
    if (status == KILN_OK && p->source.settings->patches->lights == KILN_LIGHTS_PATCHES)
        status = kiln_allocate(&p->emission, (size_t)points, sizeof *p->emission, "what patches emit", error);
    if (status == KILN_OK && has_pairs(p->source.settings->patches))
        status = kiln_allocate(&p->nodes, (size_t)points, sizeof *p->nodes, "the nodes that points gather from", error);
    if (status == KILN_OK && p->source.settings->patches->visibility == KILN_VISIBILITY_VOXELS)
        status = kiln_voxels_create(&p->voxels, p->source.backend->params.geometry, p->source.settings->patches->voxels,
                                    error);
    if (status == KILN_OK && p->source.settings->patches->order == KILN_ORDER_UNSHOT)
        status = kiln_senders_create(&p->senders, points, error);
    const uint64_t cache = cache_bytes(p->source.settings->patches);
    if (status == KILN_OK && p->source.keeps_visibility && cache > 0)
        status = kiln_visibility_cache_create(&p->cache, cache, points, error);
    return status;
}

/* Finds the shapes of this rank's points; on the host, if the baking device does not support the pass. */
static int find_own_shapes(struct kiln_patches *p, struct kiln_error *error)
{
    const struct kiln_patches_source *source = &p->source;
    const struct kiln_batch batch = {.count = source->surface->tile_run_count, .take = take_shapes, .context = p};
    const bool here = kiln_backend_takes(source->backend, &kiln_pass_shapes, NULL);
    struct kiln_backend *host = NULL;
    uint64_t rays = 0;
    int status = here ? KILN_OK : kiln_landing_host(&host, source->backend, error);
    if (status == KILN_OK)
        status = kiln_backend_run(host != NULL ? host : source->backend, &kiln_pass_shapes, NULL, &batch, &rays, error);
    kiln_backend_destroy(&host);
    return status;
}

/* Collective. */
static int find_shapes(struct kiln_patches *p, struct kiln_error *error)
{
    const struct kiln_patches_source *source = &p->source;
    struct rank_ranges rank_ranges = {NULL, NULL};
    int status = make_room(p, error);
    if (status == KILN_OK)
        status = find_own_shapes(p, error);
    status = kiln_agree(source->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_agree(source->communicator, allocate_rank_ranges(p, &rank_ranges, error), error);
    if (status == KILN_OK) {
        gather_rank_ranges(p, &rank_ranges);
        share(p, &rank_ranges, p->points, sizeof *p->points);
    }
    if (status == KILN_OK && p->emission != NULL)
        share(p, &rank_ranges, p->emission, sizeof *p->emission);
    if (status == KILN_OK)
        number_points(p);
    kiln_free(&rank_ranges.first);
    kiln_free(&rank_ranges.count);
    return status;
}

/* ---- the light of points ---- */

/* Gets the radiosity that a point sends in the step, W/m2. The step before the first bounce sends the emission. The
 * function is used as kiln_link_of_point, too. */
static void light_of(const void *context, uint64_t point, float radiosity[3])
{
    const struct kiln_patches *p = context;
    if (p->step->bounce == 0) {
        memcpy(radiosity, p->emission[point], sizeof p->emission[point]);
        return;
    }
    kiln_radiosity_unpack(p->radiosity[point], radiosity);
    for (int c = 0; c < 3; c++)
        radiosity[c] *= (float)p->source.settings->patches->albedo_scale;
}

/* ---- nodes ---- */

/* Appends the point's node, if it sends light. */
static uint64_t add_point(struct kiln_patches *p, uint64_t point)
{
    if (point == KILN_NO_POINT || !(p->points[point].area > 0.0f))
        return 0;
    struct kiln_patch_node *node = &p->nodes[p->parameters.count++];
    if (p->senders != NULL)
        kiln_senders_add(p->senders, p->parameters.count - 1, point);
    *node = (struct kiln_patch_node){.patch = p->points[point], .centre = p->points[point].centre};
    light_of(p, point, node->radiosity);
    return 1;
}

static void add_points(struct kiln_patches *p)
{
    const struct kiln_surface *s = p->source.surface;
    for (uint64_t t = 0; t < s->tile_count; t++)
        for (uint64_t rest = s->tiles[t].mask; rest != 0; rest &= rest - 1)
            (void)add_point(p, point_at(s, &s->tiles[t], (uint32_t)__builtin_ctzll(rest)));
}

/* ---- nodes of several texels ---- */

/* A square of texels of a lightmap. */
struct square {
    uint32_t map, x, y, side;
};

/* Mean of several nodes, weighted by their areas. */
struct mean {
    double area, radiosity[3], deviation; /* deviation: largest one among the nodes' radiosities */
    struct kiln_vec3 centre, normal;
};

static double largest_difference(const float radiosity[3], const double mean[3])
{
    return fmax(fmax(fabs((double)radiosity[0] - mean[0]), fabs((double)radiosity[1] - mean[1])),
                fabs((double)radiosity[2] - mean[2]));
}

static struct mean mean_of(const struct kiln_patch_node *nodes, uint64_t count)
{
    struct mean mean = {.area = 0.0};
    for (uint64_t i = 0; i < count; i++)
        mean.area += (double)nodes[i].patch.area;
    for (uint64_t i = 0; i < count; i++) {
        const float share = (float)((double)nodes[i].patch.area / mean.area);
        mean.centre = vec3_madd(mean.centre, nodes[i].centre, share);
        mean.normal = vec3_madd(mean.normal, nodes[i].patch.normal, share);
        for (int c = 0; c < 3; c++)
            mean.radiosity[c] += (double)share * (double)nodes[i].radiosity[c];
    }
    for (uint64_t i = 0; i < count; i++)
        mean.deviation = fmax(mean.deviation, largest_difference(nodes[i].radiosity, mean.radiosity));
    return mean;
}

/* Whether nodes belong together: they are adjacent and have similar normals. Nodes of two charts in one window do not,
 * unless one chart continues the other. */
static bool are_of_one_chart(const struct kiln_patch_node *nodes, uint64_t count, const struct mean *mean)
{
    float side = 0.0f;
    for (uint64_t i = 0; i < count; i++)
        side = fmaxf(side, fmaxf(vec3_length(nodes[i].patch.edge_s), vec3_length(nodes[i].patch.edge_t)));
    for (uint64_t i = 0; i < count; i++)
        if (vec3_dot(nodes[i].patch.normal, nodes[0].patch.normal) < KILN_NODE_ALIKE ||
            vec3_length(vec3_sub(nodes[i].centre, mean->centre)) > 1.25f * side)
            return false;
    return true;
}

/* Whether the nodes of a square may be one. */
static bool may_join(const struct kiln_patches *p, const struct kiln_patch_node *nodes, uint64_t count,
                     const struct mean *mean)
{
    const double most = p->source.settings->patches->subdivide;
    if (!are_of_one_chart(nodes, count, mean))
        return false;
    if (!(most > 0.0))
        return true;
    double bend = 0.0;
    for (uint64_t i = 0; i < count; i++)
        bend = fmax(bend, (double)vec3_length(vec3_sub(nodes[i].patch.normal, mean->normal)));
    return 0.5 * mean->deviation + 0.5 * bend * p->level < most * p->level;
}

/* Returns a random number in [0, 1) for the window and the step. */
static double chance_of(const struct kiln_patches *p, struct square q)
{
    const uint32_t where = kiln_hash2(kiln_hash2(q.map, q.side), kiln_hash2(q.x, q.y));
    return (double)kiln_hash2(kiln_hash2(where, p->step->stream), (uint32_t)p->source.settings->seed) * 0x1p-32;
}

/* Which of the nodes stands for all. */
static uint64_t choose(const struct kiln_patches *p, struct square q, const struct kiln_patch_node *nodes,
                       uint64_t count, const struct mean *mean)
{
    const int how = p->source.settings->patches->undersample;
    uint64_t chosen = 0;
    if (how == KILN_SAMPLE_RANDOM) {
        double left = chance_of(p, q) * mean->area - (double)nodes[0].patch.area;
        while (left >= 0.0 && chosen + 1 < count)
            left -= (double)nodes[++chosen].patch.area;
    } else if (how != KILN_SAMPLE_STRIDE) { /* the node nearest to the centre */
        for (uint64_t i = 1; i < count; i++)
            if (vec3_length(vec3_sub(nodes[i].patch.place, mean->centre)) <
                vec3_length(vec3_sub(nodes[chosen].patch.place, mean->centre)))
                chosen = i;
    }
    return chosen;
}

/* Records the side of the node that this rank's points of a square belong to, if the data has that field. */
static void note_node(const struct kiln_patches *p, struct square q)
{
    const struct kiln_surface *s = p->source.surface;
    uint16_t *node = p->source.own != NULL ? (*p->source.own)->node : NULL;
    for (uint32_t i = 0; node != NULL && i < q.side * q.side; i++) {
        const uint32_t x = q.x + i % q.side, y = q.y + i / q.side;
        if (x >= s->lightmaps[q.map].width || y >= s->lightmaps[q.map].height)
            continue;
        const uint64_t point = kiln_surface_find(s, q.map, x, y).at;
        if (point != KILN_NO_POINT && point - s->first.at < s->count)
            node[point - s->first.at] = p->points[point].area > 0.0f ? (uint16_t)q.side : 0;
    }
}

/* Joins the last `count` nodes to one. */
static void join(struct kiln_patches *p, struct square q, uint64_t count, const struct mean *mean)
{
    const int how = p->source.settings->patches->undersample;
    struct kiln_patch_node *nodes = &p->nodes[p->parameters.count - count];
    struct kiln_patch_node one = nodes[choose(p, q, nodes, count, mean)];
    const float grown = (float)sqrt(mean->area / (double)one.patch.area);
    one.patch.area = (float)mean->area;
    one.patch.edge_s = vec3_scale(one.patch.edge_s, grown);
    one.patch.edge_t = vec3_scale(one.patch.edge_t, grown);
    if (how != KILN_SAMPLE_STRIDE && how != KILN_SAMPLE_RANDOM) {
        one.patch.normal = vec3_normalize(mean->normal);
        one.centre = mean->centre;
        for (int c = 0; c < 3; c++)
            one.radiosity[c] = (float)mean->radiosity[c];
    }
    nodes[0] = one;
    p->parameters.count -= count - 1;
}

/* Appends the nodes of a square, recursively from single texels up; returns their number. A square of several nodes is
 * not joined any further. */
static uint64_t add_square(struct kiln_patches *p, struct square q)
{
    const struct kiln_surface *s = p->source.surface;
    const struct kiln_lightmap *map = &s->lightmaps[q.map];
    if (q.x >= map->width || q.y >= map->height)
        return 0;
    if (q.side == 1) {
        note_node(p, q);
        return add_point(p, kiln_surface_find(s, q.map, q.x, q.y).at);
    }
    const uint32_t half = q.side / 2;
    uint64_t count = 0, parts = 0;
    for (uint32_t i = 0; i < 4; i++) {
        const uint64_t more = add_square(p, (struct square){q.map, q.x + i % 2 * half, q.y + i / 2 * half, half});
        count += more;
        parts += more > 0;
    }
    if (count < 2 || count > parts)
        return count;
    const struct kiln_patch_node *nodes = &p->nodes[p->parameters.count - count];
    const struct mean mean = mean_of(nodes, count);
    if (!may_join(p, nodes, count, &mean))
        return count;
    join(p, q, count, &mean);
    note_node(p, q);
    return 1;
}

static void add_squares(struct kiln_patches *p, uint32_t side)
{
    const struct kiln_surface *s = p->source.surface;
    for (uint32_t m = 0; m < s->map_count; m++)
        for (uint32_t y = 0; y < s->lightmaps[m].height; y += side)
            for (uint32_t x = 0; x < s->lightmaps[m].width; x += side)
                (void)add_square(p, (struct square){m, x, y, side});
}

/* ---- a step ---- */

/* Returns the mean radiosity in its largest channel, the same on all ranks. Deviations are relative to it. */
static double level_of(struct kiln_patches *p)
{
    p->parameters.count = 0;
    add_points(p);
    const struct mean mean = mean_of(p->nodes, p->parameters.count);
    return fmax(mean.radiosity[0], fmax(mean.radiosity[1], mean.radiosity[2]));
}

static void make_nodes(struct kiln_patches *p)
{
    const struct kiln_patch_settings *settings = p->source.settings->patches;
    const int log = settings->subdivide > 0.0                  ? settings->node_max
                    : settings->undersample != KILN_SAMPLE_ALL ? settings->window
                                                               : 0;
    p->level = settings->subdivide > 0.0 ? level_of(p) : 0.0;
    p->parameters.count = 0;
    if (p->senders != NULL)
        kiln_senders_begin(p->senders);
    if (log > 0)
        add_squares(p, 1u << log);
    else
        add_points(p);
}

/* About an hour of one core. */
static void warn_of_pairs(const struct kiln_patches *p)
{
    const double points = (double)p->source.surface->point_count, nodes = (double)p->parameters.count;
    int rank;
    (void)MPI_Comm_rank(p->source.communicator, &rank);
    if (rank == 0 && points * nodes > 1e11)
        kiln_print(
            stderr,
            "kiln: warning: %.0f surface points gather from %.0f patches, which are %.2g pairs in each bounce and "
            "take hours; larger windows (--undersample mipmap:16), fewer texels or --method cells take less\n",
            points, nodes, points * nodes);
}

/* ---- links ---- */

/* Computes the luminance that decides which links are opened: emission, or direct light reflected by all points. Direct
 * light is taken from the results, so that links are the same in any bounce. Without results it is the light sent
 * now. */
static int find_first_light(struct kiln_patches *p, float *light, struct kiln_error *error)
{
    const struct kiln_surface *s = p->source.surface;
    const float *direct = p->source.direct != NULL ? *p->source.direct : NULL;
    struct rank_ranges rank_ranges = {NULL, NULL};
    for (uint64_t i = 0; i < s->point_count && (direct == NULL || p->step->bounce == 0); i++) {
        float radiosity[3];
        light_of(p, i, radiosity);
        light[i] = kiln_luminance_in_float(radiosity);
    }
    if (direct == NULL || p->step->bounce == 0)
        return KILN_OK;
    const int status = kiln_agree(p->source.communicator, allocate_rank_ranges(p, &rank_ranges, error), error);
    for (struct kiln_own_point own = {0}; status == KILN_OK && own.at < s->count; own.at++) {
        float albedo[3], radiosity[3];
        kiln_point_albedo(s, own, albedo);
        for (uint64_t c = 0; c < 3; c++)
            radiosity[c] = albedo[c] * direct[3 * own.at + c];
        light[s->first.at + own.at] = kiln_luminance_in_float(radiosity);
    }
    if (status == KILN_OK) {
        gather_rank_ranges(p, &rank_ranges);
        share(p, &rank_ranges, light, sizeof *light);
    }
    kiln_free(&rank_ranges.first);
    kiln_free(&rank_ranges.count);
    return status;
}

static int create_links(struct kiln_patches *p, const float *light, struct kiln_error *error)
{
    const struct kiln_patch_settings *settings = p->source.settings->patches;
    const struct kiln_transport *replayed = p->step->bounce > 0 ? p->source.replayed : NULL;
    const struct kiln_links_source source = {
        p->source.surface,
        p->points,
        p->rooms,
        light,
        {settings->link_error, kiln_links_samples(settings->link_error, p->step->samples)},
        p->source.settings->target_error,
        KILN_LINKS_STREAM,
        replayed != NULL && replayed->of_links && replayed->replays ? replayed : NULL};
    return kiln_links_create(&p->links, &source, error);
}

/* Collective. */
static int make_links(struct kiln_patches *p, struct kiln_error *error)
{
    const struct kiln_surface *s = p->source.surface;
    float *light = NULL;
    int status = kiln_agree(
        p->source.communicator,
        kiln_allocate(&light, (size_t)s->point_count, sizeof *light, "the first light of links", error), error);
    const struct kiln_rooms_source rooms = {p->source.communicator, s, p->source.backend, p->points};
    KILN_TRY(status);
    if (p->rooms == NULL)
        KILN_TRY(kiln_rooms_find(&rooms, &p->rooms, error));
    KILN_TRY(find_first_light(p, light, error));
    KILN_TRY(kiln_agree(p->source.communicator, create_links(p, light, error), error));
end:
    p->links_of_emission = p->step->bounce == 0;
    kiln_free(&light);
    return status;
}

/* Collective. */
static int update_links(struct kiln_patches *p, const void **parameters, struct kiln_error *error)
{
    const struct kiln_links_parameters *of_links = NULL;
    int status = KILN_OK;
    if (p->links != NULL && p->links_of_emission && p->step->bounce > 0)
        kiln_links_destroy(&p->links);
    if (p->links == NULL)
        status = make_links(p, error);
    if (status == KILN_OK)
        status = kiln_agree(p->source.communicator,
                            kiln_links_update(p->links, p->step->bounce, light_of, p, &of_links, error), error);
    *parameters = of_links;
    return status;
}

/* Collective. Updates the parameters of a step of the directions pass. */
static int update_directions(struct kiln_patches *p, const uint64_t *radiosity, const struct kiln_step *step,
                             const void **parameters, struct kiln_error *error)
{
    const struct kiln_patch_settings *settings = p->source.settings->patches;
    int status = p->points == NULL && needs_shapes(settings) ? find_shapes(p, error) : KILN_OK;
    if (status == KILN_OK && p->directions == NULL) {
        const struct kiln_directions_source source = {p->source.surface, settings, p->points, p->emission};
        status = kiln_directions_create(&p->directions, &source, step->samples, error);
        status = kiln_agree(p->source.communicator, status, error);
    }
    if (status == KILN_OK)
        *parameters = kiln_directions_update(p->directions, radiosity, step->bounce == 0);
    return status;
}

int kiln_patches_update(struct kiln_patches *p, const uint64_t *radiosity, const struct kiln_step *step,
                        const void **parameters, struct kiln_error *error)
{
    const bool clamps = p->source.settings->patches->clamp, sends = kiln_step_has(step, KILN_WITH(senders));
    const bool first = p->points == NULL;
    if (p->source.settings->patches->gather != KILN_GATHER_PAIRS)
        return update_directions(p, radiosity, step, parameters, error);
    int status = first ? find_shapes(p, error) : KILN_OK;
    if (status != KILN_OK)
        return status;
    p->radiosity = radiosity;
    p->step = step;
    if (has_links(p))
        return update_links(p, parameters, error);
    p->parameters = (struct kiln_patches_parameters){.points = p->points,
                                                     .nodes = p->nodes,
                                                     .most_factor = clamps ? KILN_CLAMP_FACTOR : 0.0,
                                                     .most_added = clamps ? KILN_CLAMP_ADDED : 0.0,
                                                     .cache = p->cache,
                                                     .voxels = p->voxels};
    make_nodes(p);
    if (first)
        warn_of_pairs(p);
    struct kiln_patches_parameters *of_step = sends ? &p->of_round : &p->parameters;
    if (sends) {
        p->of_round = p->parameters;
        kiln_senders_choose(p->senders, &p->of_round);
    }
    if (p->cache != NULL)
        status = kiln_agree(
            p->source.communicator,
            kiln_visibility_cache_begin(p->cache, p->source.surface, of_step->nodes, of_step->count, error), error);
    *parameters = of_step;
    return status;
}
