/* The gather pass (worker/pass/gather.h): cosine-distributed rays of a tile run's points and the radiosity that they
 * find. The guided pass (worker/pass/guided.h), which is the same with a guide. The caustic pass
 * (worker/pass/caustic.h), whose rays look for what chains bring of lamps and sky, and the weighed pass
 * (worker/pass/weighed.h), where light paths have a part in that. The reference pass (worker/pass/reference.h), of
 * whose rays paths go on. And the directions pass (worker/pass/directions.h), whose rays go elsewhere. */
#include <math.h>
#include <string.h>

#include "shaders/shared/color.h"
#include "shaders/shared/streams.h"
#include "shaders/shared/warp.h"
#include "worker/backend/embree/chain_weighed.h"
#include "worker/backend/embree/directed.h"
#include "worker/backend/embree/kept_rows.h"
#include "worker/backend/embree/light_samples.h"
#include "worker/backend/embree/light_vertices.h"
#include "worker/backend/embree/lookup.h"
#include "worker/backend/embree/mirror_images.h"
#include "worker/backend/embree/path.h"
#include "worker/backend/embree/reference.h"
#include "worker/backend/embree/techniques.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/backend/guide.h"
#include "worker/base/memory.h"
#include "worker/pass/gather.h"
#include "worker/pass/guided.h"

/* The exchanges of --mis optimal and light; and which of them the products of pilots are of. */
enum { EXCHANGES_AND_LIGHT = KILN_CAUSTIC_EXCHANGES + 1 };
static const uint8_t product_of[KILN_CAUSTIC_PRODUCTS][2] = {{0, 0}, {0, 1}, {1, 1}, {0, 2}, {1, 2}};

/* A thread's working set. */
struct gather_work {
    struct tile_run_rays *rays;
    uint32_t stream;
    float range; /* m: rays of points that see a radiance probe end there */
    struct rays_found found;
    struct kept_rows rows; /* of the gather pass */
    /* where the backend has radiance probes: of each valid point, the word of surface->near_probes; of each lane
     * whether its point sees one, the distance at which it leaves the scene's box, and the probe that it asks; and the
     * lanes that ask, with the ends of their rays */
    uint32_t near_probes[RAY_LANES];
    bool sees[RAY_LANES];
    float far[RAY_LANES];
    uint32_t probe[RAY_LANES], asking;
    uint8_t asks[RAY_LANES];
    struct kiln_vec3 end[RAY_LANES];
    /* where rays go on in chains: which lanes do, and what a chain has found */
    bool chained[RAY_LANES];
    float lost[2][RAY_LANES]; /* and of each lane what has escaped and was blocked */
    struct walk walk;
    struct chain_found chain;
    struct kiln_light_choice *choices; /* the caustic, the weighed and the reference pass; else NULL */
    /* the weighed pass; else NULL. And of each point the area that is there to be lit, m2 */
    const struct kiln_caustic_techniques *techniques;
    double area[RAY_LANES];
    struct kiln_caustic_factors factors[RAY_LANES];
    struct chain_weighed weighed;
    /* its pilots: sums over a point's rays, by luminance, of what hits and what samples find, of quarters of the rays
     * and of squares; or of what exchanges add and of light, and of the products of the former with either */
    double pilot[KILN_CAUSTIC_GATHERS][RAY_QUARTERS][RAY_LANES], squares[KILN_CAUSTIC_GATHERS][RAY_LANES];
    double exchanges[EXCHANGES_AND_LIGHT][RAY_LANES], products[KILN_CAUSTIC_PRODUCTS][RAY_LANES];
    double image_error[RAY_LANES];         /* of the sum of what mirror images bring; 0 elsewhere */
    const struct light_vertex_cache *kept; /* NULL: gather rays connect with no light paths */
    /* the reference pass; else NULL; and what of a point's incident light has bounced as often as there may be bounces
     */
    const struct kiln_reference_parameters *reference;
    double last[RAY_LANES][3];
    struct reference_paths *paths; /* of bdpt and vcm */
    struct subpaths subpaths;
    bool receives_only;         /* no ray meets the tile run's object */
    double plain[3][RAY_LANES]; /* of rays that all weigh 1: incident light */
    /* sums of a point */
    double incident[RAY_LANES][3], irradiance[RAY_LANES][3], quarter[RAY_QUARTERS][RAY_LANES];
    double escaped[RAY_LANES], blocked[RAY_LANES], glass[RAY_LANES][3], gloss[RAY_LANES][3];
    /* the directions pass; else NULL; and what the rays' light is multiplied by */
    struct directed *directed;
    const struct kiln_directions_parameters *directions;
    /* the guided pass; else NULL. Cells along a side of the tile run's guide; luminance that was found in each, squared
     * and summed up; the guide that is followed */
    const struct kiln_guided_parameters *guided;
    uint32_t side, shift; /* and by how much the random numbers are shifted right to have a cell's place */
    double square[KILN_GUIDE_SIDE * KILN_GUIDE_SIDE];
    float guide[KILN_GUIDE_SIZE];
    double *groups; /* the light of groups: of each point and group KILN_GROUP_FLOATS sums; NULL: nobody asks */
};

static void work_destroy(void **work)
{
    struct gather_work *w = *work;
    if (w != NULL) {
        rays_destroy(&w->rays);
        kept_rows_release(&w->rows);
        kiln_free(&w->groups);
        kiln_free(&w->choices);
        subpaths_release(&w->subpaths);
        directed_destroy(&w->directed);
    }
    kiln_free(work);
}

static int work_create(void **work, const struct embree_backend *b, const void *parameters,
                       const struct kiln_batch *part, struct kiln_error *error)
{
    struct gather_work *w = NULL;
    int status = kiln_allocate(&w, 1, sizeof *w, "the gather pass", error);
    *work = w;
    if (status != KILN_OK)
        return status;
    w->stream = part->stream;
    w->guided = parameters;
    w->walk = (struct walk){.b = b};
    w->range = b->probes != NULL ? b->probes->grid.range : INFINITY;
    status = rays_create(&w->rays, RAYS_HALF_WAY, INFINITY, part, error);
    if (status != KILN_OK)
        work_destroy(work);
    return status;
}

/* ---- the light of groups (worker/pass/groups.h) ---- */

static size_t group_sums(const struct embree_backend *b) { return b->base.groups->lights->count * KILN_GROUP_FLOATS; }

static int groups_create(struct gather_work *w, const struct embree_backend *b, struct kiln_error *error)
{
    return b->base.groups != NULL
               ? kiln_allocate(&w->groups, RAY_LANES * group_sums(b), sizeof *w->groups, "the light of groups", error)
               : KILN_OK;
}

/* Adds the radiosity of each group at a surface point that a ray of point j has met, by its weights as incident light
 * and as irradiance. */
static inline void add_groups(const struct gather_work *w, const struct embree_backend *b, uint32_t j, uint64_t point,
                              float incident, float irradiance)
{
    const struct kiln_groups *g = b->base.groups;
    const uint64_t *radiosity = g->radiosity + point * g->lights->count;
    double *sums = w->groups + j * group_sums(b);
    for (uint32_t i = 0; i < g->lights->count; i++, sums += KILN_GROUP_FLOATS) {
        float rgb[3];
        if (radiosity[i] == 0)
            continue;
        kiln_radiosity_unpack(radiosity[i], rgb);
        for (int c = 0; c < 3; c++) {
            sums[c] += (double)(incident * rgb[c]);
            sums[3 + c] += (double)(irradiance * rgb[c]);
        }
    }
}

static void store_groups(const struct gather_work *w, const struct embree_backend *b, size_t tile_run)
{
    float *run = embree_group_run(b, tile_run);
    for (uint32_t j = 0; j < w->rays->frame.count; j++)
        for (size_t i = 0; i < group_sums(b); i++)
            embree_group_answers(run, b, w->rays->frame.place[j])[i] = (float)w->groups[j * group_sums(b) + i];
}

/* kiln_facet_weight of a lane's direction, times its weight. */
static inline float facet_weight(const struct tile_run_rays *r, uint32_t l)
{
    if (!r->frame.smooth)
        return r->weight[l];
    const float cosine =
        r->facet[0][l] * r->direction[0][l] + r->facet[1][l] * r->direction[1][l] + r->facet[2][l] * r->direction[2][l];
    const float tilt = r->facet[0][l] * r->axis[0][l] + r->facet[1][l] * r->axis[1][l] + r->facet[2][l] * r->axis[2][l];
    return kiln_facet_weight(cosine, tilt, r->cosine[l]) * r->weight[l];
}

static void count_lost(struct gather_work *w)
{
    const struct tile_run_rays *rays = w->rays;
    const struct rays_found *found = &w->found;
    for (uint32_t i = 0; i < found->escaped; i++)
        w->escaped[rays->point[found->escaped_lane[i]]] += (double)facet_weight(rays, found->escaped_lane[i]);
    for (uint32_t i = 0; i < found->blocked; i++)
        w->blocked[rays->point[found->blocked_lane[i]]] += (double)facet_weight(rays, found->blocked_lane[i]);
}

/* The ray of lane l has found so much light, its weight in it: its cell has had rays by its density. */
static inline void learn(struct gather_work *w, uint32_t step, uint32_t l, float luminance)
{
    const struct tile_run_rays *r = w->rays;
    const uint32_t k = step * r->copies + r->copy[l], u = r->scrambled[0][k] ^ r->shift_u[l],
                   v = r->scrambled[1][k] ^ r->shift_v[l];
    const uint32_t cell =
        r->guide != NULL ? kiln_guide_cell(r->guide, w->side, u, v) : (u >> w->shift) * w->side + (v >> w->shift);
    w->square[cell] += (double)luminance * (double)luminance / (double)r->weight[l];
}

/* The cosine of lane l's ray about the shading normal, of a smooth mesh. */
static inline float shading_cosine(const struct tile_run_rays *rays, uint32_t l)
{
    const struct kiln_vec3 shading =
        frame_shading(&rays->frame, rays->point[l], vec3(rays->facet[0][l], rays->facet[1][l], rays->facet[2][l]));
    return shading.x * rays->direction[0][l] + shading.y * rays->direction[1][l] + shading.z * rays->direction[2][l];
}

/* Adds radiosity that the ray of lane l has found. Returns its weight as irradiance. */
static inline float add(struct gather_work *w, uint32_t step, uint32_t l, float rgb[3], bool tints)
{
    const struct tile_run_rays *rays = w->rays;
    const uint32_t j = rays->point[l];
    const float facet = facet_weight(rays, l);
    float weight = facet, cosine = rays->cosine[l];
    for (int c = 0; c < 3 && tints; c++) {
        rgb[c] *= rays->tint[l][c];
        w->glass[j][c] += (double)(facet * (1.0f - rays->tint[l][c]));
    }
    const bool glossy = rays->frame.glossy[j];
    if (rays->frame.smooth) {
        cosine = shading_cosine(rays, l);
        weight = kiln_shading_weight(cosine, rays->cosine[l]) * rays->weight[l];
    }
    for (int c = 0; c < 3 && (rays->frame.smooth || glossy); c++)
        w->irradiance[j][c] += (double)(weight * rgb[c]);
    const float incident = glossy ? facet * frame_taken_up(&rays->frame, j, cosine) : facet;
    for (int c = 0; c < 3; c++)
        w->incident[j][c] += (double)(incident * rgb[c]);
    const float luminance = weight * kiln_luminance_in_float(rgb);
    const uint32_t quarter = w->directed != NULL ? directed_quarter(w->directed, rays, step, l)
                                                 : rays->quarter_of[step * rays->copies + rays->copy[l]];
    w->quarter[quarter][j] += (double)luminance;
    if (w->side > 0)
        learn(w, step, l, luminance);
    return weight;
}

/* Adds the radiosity lane by lane: for each point in the order of its samples, whatever the number of lanes. */
KILN_CLONES static void collect(const struct embree_backend *b, struct gather_work *w, uint32_t step)
{
    const struct rays_found *found = &w->found;
    const uint32_t count = found->count;
    const bool tints = embree_tints(b);
    const struct kiln_directions_parameters *directions = w->directions;
    const uint64_t *radiosity =
        directions != NULL && directions->radiosity != NULL ? directions->radiosity : b->radiosity;
    for (uint32_t i = 0; i < count; i++) {
        float rgb[3] = {0.0f, 0.0f, 0.0f};
        const uint32_t l = found->lane[i];
        const float facet = facet_weight(w->rays, l);
        const bool meets = found->point[i] != KILN_NO_POINT && facet > 0.0f;
        if (meets)
            kiln_radiosity_unpack(radiosity[found->point[i]], rgb);
        for (int c = 0; c < 3 && directions != NULL; c++)
            rgb[c] *= (float)directions->scale;
        const float weight = add(w, step, l, rgb, tints);
        if (meets && w->groups != NULL)
            add_groups(w, b, w->rays->point[l], found->point[i], facet, weight);
    }
}

/* Notes what the rays of a step weigh, of a smooth mesh. */
static void weigh(const struct gather_work *w, size_t tile_run, uint32_t step, uint32_t lanes)
{
    const struct tile_run_rays *rays = w->rays;
    for (uint32_t l = 0; l < lanes; l++)
        kept_rows_weigh(&w->rows, rays, tile_run, step, l, facet_weight(rays, l),
                        kiln_shading_weight(shading_cosine(rays, l), rays->cosine[l]) * rays->weight[l]);
}

/* ---- rays that all weigh 1 ---- */

/* Whether what a ray finds is added as it is, and nothing else is made of it. */
static bool is_plain(const struct gather_work *w, const struct embree_backend *b)
{
    const struct tile_run_frame *frame = &w->rays->frame;
    bool plain = b->probes == NULL && !chain_any(b) && !frame->smooth && w->rays->guide == NULL && w->side == 0 &&
                 w->directed == NULL && w->groups == NULL && !embree_tints(b);
    for (uint32_t j = 0; j < frame->count && plain; j++)
        plain = !frame->glossy[j];
    return plain;
}

/* As collect, all points at a time that take the same sample; the sums stand in `plain`. What a lane does not find is
 * 0. */
KILN_CLONES static void collect_plain(const struct embree_backend *b, struct gather_work *w, uint32_t step,
                                      uint32_t lanes)
{
    const struct rays_found *found = &w->found;
    const struct tile_run_rays *rays = w->rays;
    const uint32_t points = rays->frame.count;
    uint32_t low[RAY_LANES], high[RAY_LANES];
    for (uint32_t l = 0; l < lanes; l++)
        low[l] = high[l] = 0;
    for (uint32_t i = 0; i < found->count; i++) {
        const uint64_t packed = found->point[i] != KILN_NO_POINT ? b->radiosity[found->point[i]] : 0;
        low[found->lane[i]] = (uint32_t)packed;
        high[found->lane[i]] = (uint32_t)(packed >> 32);
    }
    for (uint32_t first = 0, c = 0; first < lanes; first += points, c++) {
        double *restrict quarter = w->quarter[rays->quarter_of[step * rays->copies + c]];
        double *restrict red = w->plain[0], *restrict green = w->plain[1], *restrict blue = w->plain[2];
        for (uint32_t j = 0; j < points; j++) {
            const uint32_t bits[3] = {kiln_radiosity_red(low[first + j]),
                                      kiln_radiosity_green(low[first + j], high[first + j]),
                                      kiln_radiosity_blue(high[first + j])};
            float rgb[3];
            memcpy(rgb, bits, sizeof rgb);
            red[j] += (double)rgb[0];
            green[j] += (double)rgb[1];
            blue[j] += (double)rgb[2];
            quarter[j] += (double)kiln_luminance_in_float(rgb);
        }
    }
}

static void take_plain(struct gather_work *w)
{
    for (uint32_t j = 0; j < w->rays->frame.count; j++)
        for (int c = 0; c < 3; c++)
            w->incident[j][c] = w->plain[c][j];
}

/* ---- with radiance probes ---- */

/* Which probes the tile run's points see. */
static void begin_probes(struct gather_work *w, const struct embree_backend *b, size_t tile_run)
{
    const struct kiln_surface *s = b->surface;
    const uint64_t first = kiln_own_of_global(s, s->tile_runs[tile_run].first).at;
    for (uint32_t j = 0; j < w->rays->frame.count; j++)
        w->near_probes[j] = s->near_probes[first + w->rays->frame.place[j]];
}

/* Rays of points that see a probe end at the range; those of range 0 are none. Returns how many there are. */
static uint64_t end_rays(struct gather_work *w, uint32_t lanes)
{
    struct tile_run_rays *rays = w->rays;
    uint64_t traced = 0;
    for (uint32_t l = 0; l < lanes; l++) {
        const bool sees = (w->near_probes[rays->point[l]] & KILN_PROBE_SEEN) != 0;
        w->sees[l] = sees;
        traced += !sees || w->range > 0.0f;
        if (sees) /* before its begin: Embree leaves such a ray out */
            rays->packets[l / PACKET].ray.tfar[l % PACKET] = w->range > 0.0f ? w->range : -1.0f;
    }
    return traced;
}

static struct kiln_vec3 origin_of(const struct tile_run_rays *r, uint32_t l)
{
    return vec3(r->origin[0][l], r->origin[1][l], r->origin[2][l]);
}

static struct kiln_vec3 direction_of(const struct tile_run_rays *r, uint32_t l)
{
    return vec3(r->direction[0][l], r->direction[1][l], r->direction[2][l]);
}

/* The random number that chooses the lane's probe. */
static uint32_t choice_of(const struct tile_run_rays *r, uint32_t step, uint32_t l)
{
    return kiln_probe_choice(kiln_gather_ray_seed(r->chance[l], rays_sample(r, step, l)));
}

/* What of the lanes ended at the range: a ray that leaves the scene's box before has escaped. The others ask a probe
 * near the end of the ray; the rays from there to their probes stand in `sight`. */
static void end_at_range(const struct embree_backend *b, struct gather_work *w, uint32_t step)
{
    struct rays_found *found = &w->found;
    const struct tile_run_rays *r = w->rays;
    const struct kiln_probe_grid *grid = &b->probes->grid;
    uint32_t lost = 0;
    w->asking = 0;
    for (uint32_t i = 0; i < found->escaped; i++) {
        const uint32_t l = found->escaped_lane[i];
        const struct kiln_vec3 origin = origin_of(r, l), direction = direction_of(r, l);
        w->far[l] = kiln_probe_far(*grid, origin, direction);
        if (!w->sees[l] || w->far[l] <= w->range) {
            found->escaped_lane[lost++] = (uint8_t)l;
            continue;
        }
        const struct kiln_vec3 end = vec3_madd(origin, direction, KILN_PROBE_END * w->range);
        w->end[w->asking] = end;
        w->probe[l] = kiln_probe_draw(grid, kiln_probe_cell(grid, end), kiln_probe_corners(*grid), end,
                                      kiln_unit_float(choice_of(r, step, l)));
        w->asks[w->asking++] = (uint8_t)l;
    }
    found->escaped = lost;
}

/* Rays from the ends of the asking lanes [first, first + PACKET) to their probes: which of them nothing bars. */
static void look_at_probes(const struct embree_backend *b, struct embree_context *context, const struct gather_work *w,
                           uint32_t first, bool free[PACKET])
{
    struct RTCRay8 rays = {.mask = {0}};
    int valid[PACKET] __attribute__((aligned(32))) = {0};
    uint32_t seed[PACKET] = {0};
    for (uint32_t i = 0; i < PACKET && first + i < w->asking; i++) {
        const uint32_t probe = w->probe[w->asks[first + i]];
        const struct kiln_vec3 to = vec3_sub(b->probes->positions[probe], w->end[first + i]);
        const float distance = vec3_length(to);
        if (kiln_probe_is_off(b->probes, probe) || !(distance > 0.0f))
            continue;
        const struct kiln_vec3 d = vec3_scale(to, 1.0f / distance);
        valid[i] = -1;
        seed[i] = kiln_ray_seed(w->end[first + i], d);
        rays.org_x[i] = w->end[first + i].x, rays.org_y[i] = w->end[first + i].y, rays.org_z[i] = w->end[first + i].z;
        rays.dir_x[i] = d.x, rays.dir_y[i] = d.y, rays.dir_z[i] = d.z;
        rays.tfar[i] = distance + KILN_PROBE_CLEAR * b->probes->grid.spacing;
        rays.mask[i] = ~0u;
    }
    embree_blocked8(b, context, valid, &rays, seed);
    for (int i = 0; i < PACKET; i++)
        free[i] = valid[i] != 0 && !(rays.tfar[i] < 0.0f);
}

/* The asking lanes whose probe is not seen from the end of the ray ask one that the point sees. */
static void settle_probes(const struct embree_backend *b, struct embree_context *context, struct gather_work *w,
                          uint32_t step)
{
    for (uint32_t first = 0; first < w->asking; first += PACKET) {
        bool free[PACKET] = {false};
        if (w->range > 0.0f)
            look_at_probes(b, context, w, first, free);
        for (uint32_t i = 0; i < PACKET && first + i < w->asking; i++) {
            const uint32_t l = w->asks[first + i], near = w->near_probes[w->rays->point[l]];
            if (!free[i])
                w->probe[l] =
                    kiln_probe_draw(&b->probes->grid, near >> KILN_PROBE_CORNERS, near & KILN_PROBE_SEEN,
                                    origin_of(w->rays, l), kiln_unit_float(kiln_hash1(choice_of(w->rays, step, l))));
        }
    }
}

/* What a ray that asks a probe finds, as radiosity. */
static void ask_probe(const struct embree_backend *b, const struct gather_work *w, uint32_t l, float rgb[3])
{
    if (facet_weight(w->rays, l) > 0.0f)
        kiln_probe_ask(b->probes, w->probe[l], origin_of(w->rays, l), direction_of(w->rays, l), w->far[l], rgb);
    for (int c = 0; c < 3; c++)
        rgb[c] *= (float)KILN_PI; /* as radiosity */
}

/* ---- with chains ---- */

/* Whether the ray of lane l goes on in a chain: not one that begins below its facet and may be inside of something. */
static bool is_chain(const struct embree_backend *b, const struct tile_run_rays *r, uint32_t l)
{
    return facet_weight(r, l) > 0.0f && chain_begins_at(b, r, l);
}

/* Which lanes go on in chains; those among the blocked ones are taken out there. */
static void find_chains(const struct embree_backend *b, struct gather_work *w)
{
    struct rays_found *found = &w->found;
    uint32_t blocked = 0;
    memset(w->chained, 0, sizeof w->chained);
    memset(w->lost, 0, sizeof w->lost);
    for (uint32_t i = 0; i < found->count; i++)
        w->chained[found->lane[i]] = is_chain(b, w->rays, found->lane[i]);
    for (uint32_t i = 0; i < found->blocked; i++) {
        const uint32_t l = found->blocked_lane[i];
        w->chained[l] = is_chain(b, w->rays, l);
        if (!w->chained[l])
            found->blocked_lane[blocked++] = (uint8_t)l;
    }
    found->blocked = blocked;
}

static void follow(struct gather_work *w, uint32_t step, uint32_t l, bool radiosity)
{
    const struct tile_run_rays *r = w->rays;
    const struct RTCRayHit ray = rays_lane(r, l);
    chain_follow(&w->walk, r->chance[l], rays_sample(r, step, l), &ray, radiosity, &w->chain);
}

/* Counts what the chain of lane l has lost: a share of what the tint of its first ray leaves. */
static void count_chain(struct gather_work *w, uint32_t l, bool tints)
{
    const struct tile_run_rays *r = w->rays;
    const float facet = facet_weight(r, l), white[3] = {1.0f, 1.0f, 1.0f}, *tint = tints ? r->tint[l] : white;
    const float mean = (tint[0] + tint[1] + tint[2]) * (1.0f / 3.0f);
    w->lost[0][l] = mean * w->chain.escaped;
    w->lost[1][l] = mean * w->chain.blocked;
    for (int c = 0; c < 3; c++) /* of each colour all is somewhere */
        w->gloss[r->point[l]][c] +=
            (double)(facet * (tint[c] * w->chain.gloss[c] + (tint[c] - mean) * (w->chain.escaped + w->chain.blocked)));
}

/* As count_lost: lane by lane. */
static void count_lost_in_order(struct gather_work *w, uint32_t lanes)
{
    const struct rays_found *found = &w->found;
    for (uint32_t i = 0; i < found->escaped; i++)
        w->lost[0][found->escaped_lane[i]] = 1.0f;
    for (uint32_t i = 0; i < found->blocked; i++)
        w->lost[1][found->blocked_lane[i]] = 1.0f;
    for (uint32_t l = 0; l < lanes; l++) {
        const double facet = (double)facet_weight(w->rays, l);
        w->escaped[w->rays->point[l]] += facet * (double)w->lost[0][l];
        w->blocked[w->rays->point[l]] += facet * (double)w->lost[1][l];
    }
}

/* ---- chains that are kept ---- */

/* The chain of lane l, which is kept where chains are. */
static void follow_and_keep(struct gather_work *w, uint32_t step, uint32_t l, bool tints)
{
    if (!kept_rows_note_chains(&w->rows)) {
        follow(w, step, l, true);
        return;
    }
    const uint32_t j = w->rays->point[l];
    w->walk.notes = kept_chains_ray(&w->rows.chains, j, tints ? w->rays->tint[l] : NULL);
    follow(w, step, l, true);
    w->walk.notes = NULL;
    *kept_rows_word(&w->rows, w->rays, step, l) = kept_chains_end(&w->rows.chains, j, tints);
}

/* A ray that ends at the first surface, and is tinted on its way there. */
static void keep_tint(struct gather_work *w, uint32_t step, uint32_t l, uint64_t point)
{
    const float *tint = w->rays->tint[l], all[3] = {1.0f, 1.0f, 1.0f};
    const uint32_t j = w->rays->point[l];
    if (!kept_rows_note_chains(&w->rows) || (tint[0] == 1.0f && tint[1] == 1.0f && tint[2] == 1.0f))
        return;
    kept_chains_answer(kept_chains_ray(&w->rows.chains, j, tint), (uint32_t)point, all);
    *kept_rows_word(&w->rows, w->rays, step, l) = kept_chains_end(&w->rows.chains, j, true);
}

/* As collect_lanes, of rays that were found in a file. What they have lost the points' records say. */
static void collect_kept(const struct embree_backend *b, struct gather_work *w, uint32_t step, uint32_t lanes)
{
    for (uint32_t l = 0; l < lanes; l++) {
        float rgb[3] = {0.0f, 0.0f, 0.0f};
        const uint32_t word = *kept_rows_word(&w->rows, w->rays, step, l);
        if (word == KILN_ROW_ESCAPED || word == KILN_ROW_BLOCKED)
            continue;
        if (word == KILN_ROW_CHAIN || word == KILN_ROW_TINTED)
            kept_chains_light(&w->rows.chains, w->rays->point[l], word == KILN_ROW_TINTED, b->radiosity, rgb);
        else if (word < KILN_ROW_POINTS && facet_weight(w->rays, l) > 0.0f)
            kiln_radiosity_unpack(b->radiosity[word], rgb);
        add(w, step, l, rgb, false);
    }
}

/* What the points' rays have lost. */
static void take_lost(struct gather_work *w)
{
    for (uint32_t j = 0; j < w->rays->frame.count; j++) {
        const struct kiln_row_chain *record = &w->rows.chains.record[j];
        w->escaped[j] = (double)record->escaped;
        w->blocked[j] = (double)record->blocked;
        for (int c = 0; c < 3; c++) {
            w->glass[j][c] = (double)record->glass[c];
            w->gloss[j][c] = (double)record->gloss[c];
        }
    }
}

/* As count_lost and collect, where rays end at probes or go on in chains: what surfaces, probes and chains send, lane
 * by lane, so that a point's samples are added in their order. */
static void collect_lanes(const struct embree_backend *b, struct embree_context *context, struct gather_work *w,
                          uint32_t step, uint32_t lanes)
{
    const struct rays_found *found = &w->found;
    const bool tints = embree_tints(b), chains = chain_any(b);
    w->asking = 0;
    w->walk.context = context;
    if (chains)
        find_chains(b, w);
    if (b->probes != NULL) {
        end_at_range(b, w, step);
        settle_probes(b, context, w, step);
    }
    for (uint32_t l = 0, hit = 0, ask = 0; l < lanes; l++) {
        float rgb[3] = {0.0f, 0.0f, 0.0f};
        const bool is_hit = hit < found->count && found->lane[hit] == l, asks = ask < w->asking && w->asks[ask] == l;
        if (chains && w->chained[l]) {
            follow_and_keep(w, step, l, tints);
            count_chain(w, l, tints);
            memcpy(rgb, w->chain.radiosity, sizeof rgb);
        } else if (is_hit) {
            if (facet_weight(w->rays, l) > 0.0f && found->point[hit] != KILN_NO_POINT) {
                kiln_radiosity_unpack(b->radiosity[found->point[hit]], rgb);
                if (tints)
                    keep_tint(w, step, l, found->point[hit]);
            }
        } else if (asks) {
            ask_probe(b, w, l, rgb);
        } else {
            continue;
        }
        hit += is_hit;
        ask += asks;
        add(w, step, l, rgb, tints);
    }
    if (chains)
        count_lost_in_order(w, lanes);
    else
        count_lost(w);
}

/* ---- caustics ---- */

/* The areas of the tile run's points, and the factors of the techniques there. */
static void find_areas(struct gather_work *w, const struct embree_backend *b, size_t tile_run)
{
    const struct kiln_caustic_techniques *t = w->techniques;
    const struct tile_run_frame *frame = &w->rays->frame;
    const uint64_t first = kiln_own_of_global(b->surface, b->surface->tile_runs[tile_run].first).at;
    for (uint32_t j = 0; j < frame->count; j++) {
        const struct kiln_own_point own = {first + frame->place[j]};
        w->area[j] = kiln_lit_area(b->surface, own, frame->present[j]);
        w->factors[j] = t->factors != NULL ? t->factors[t->region_of[own.at]] : kiln_caustic_factors_alike;
    }
}

static struct kiln_vec3 facet_of(const struct tile_run_rays *r, uint32_t l)
{
    return vec3(r->facet[0][l], r->facet[1][l], r->facet[2][l]);
}

static void follow_weighed(struct gather_work *w, uint32_t step, uint32_t l, uint32_t samples)
{
    const struct tile_run_rays *r = w->rays;
    const struct RTCRayHit ray = rays_lane(r, l);
    const uint32_t j = r->point[l];
    const struct kiln_caustic_gathered sums = kiln_caustic_gather(
        w->area[j], (double)samples, (double)w->factors[j].land, techniques_connections(w->techniques),
        fabs((double)vec3_dot(facet_of(r, l), direction_of(r, l))));
    chain_follow_weighed(&w->walk, w->techniques, &sums, &w->factors[j], r->chance[l], rays_sample(r, step, l), &ray,
                         &w->weighed);
}

/* Of a pilot's ray: what exchanges would add to its light, and that. */
static void note_exchanges(struct gather_work *w, uint32_t l)
{
    const uint32_t j = w->rays->point[l];
    const double scale = KILN_PI * (double)facet_weight(w->rays, l);
    double x[EXCHANGES_AND_LIGHT] = {0.0};
    for (int e = 0; e < KILN_CAUSTIC_EXCHANGES; e++)
        x[e] = scale * w->weighed.exchanged[e];
    for (int t = 0; t < KILN_CAUSTIC_GATHERS; t++)
        x[KILN_CAUSTIC_EXCHANGES] += scale * (double)kiln_luminance_in_float(w->weighed.light[t]);
    for (int i = 0; i < EXCHANGES_AND_LIGHT; i++)
        w->exchanges[i][j] += x[i];
    for (int p = 0; p < KILN_CAUSTIC_PRODUCTS; p++)
        w->products[p][j] += x[product_of[p][0]] * x[product_of[p][1]];
}

/* Of a pilot's ray: what it finds by each technique alone. */
static void note_alone(struct gather_work *w, uint32_t step, uint32_t l)
{
    const struct tile_run_rays *r = w->rays;
    const uint32_t j = r->point[l], quarter = r->quarter_of[step * r->copies + r->copy[l]];
    const double scale = KILN_PI * (double)facet_weight(r, l);
    for (int t = 0; t < KILN_CAUSTIC_GATHERS; t++) {
        const double x = scale * (double)kiln_luminance_in_float(w->weighed.light[t]);
        w->pilot[t][quarter][j] += x;
        w->squares[t][j] += x * x;
    }
}

static void note_pilot(struct gather_work *w, uint32_t step, uint32_t l)
{
    follow_weighed(w, step, l, w->techniques->rays);
    if (w->techniques->mis == KILN_MIS_OPTIMAL)
        note_exchanges(w, l);
    else
        note_alone(w, step, l);
}

static void store_alone(const struct gather_work *w, uint32_t j, struct kiln_caustic_moments *m)
{
    const double n = (double)w->rays->samples;
    for (int t = 0; t < KILN_CAUSTIC_GATHERS; t++) {
        double sum = 0.0, quarters = 0.0;
        for (int q = 0; q < RAY_QUARTERS; q++) {
            sum += w->pilot[t][q][j];
            quarters += w->pilot[t][q][j] * w->pilot[t][q][j];
        }
        m->square[t] = (float)(w->squares[t][j] / n);
        m->variance[t] = (float)(fmax(0.0, w->squares[t][j] - sum * sum / n) / (n - 1.0));
        m->net[t] = (float)(fmax(0.0, quarters - sum * sum / RAY_QUARTERS) * RAY_QUARTERS / (RAY_QUARTERS - 1) / n);
    }
}

/* Of the mean of the rays that there will be. */
static void store_exchanges(const struct gather_work *w, uint32_t j, struct kiln_caustic_moments *m)
{
    const double n = (double)w->rays->samples, scale = 1.0 / ((n - 1.0) * (double)w->techniques->rays);
    for (int p = 0; p < KILN_CAUSTIC_PRODUCTS; p++) {
        const uint8_t *of = product_of[p];
        m->product[p] = (float)(scale * (w->products[p][j] - w->exchanges[of[0]][j] * w->exchanges[of[1]][j] / n));
    }
}

/* Moments of the tile run's points. */
static void store_moments(const struct gather_work *w, const struct embree_backend *b, size_t tile_run)
{
    const struct tile_run_frame *frame = &w->rays->frame;
    const uint64_t first = kiln_own_of_global(b->surface, b->surface->tile_runs[tile_run].first).at;
    for (uint32_t j = 0; j < frame->count; j++) {
        struct kiln_caustic_moments *m = &w->techniques->moments[first + frame->place[j]];
        if (w->techniques->mis == KILN_MIS_OPTIMAL)
            store_exchanges(w, j, m);
        else
            store_alone(w, j, m);
    }
}

#define CONNECTION_USE 0 /* of random numbers: it is no surface's (shaders/shared/path.h) */

/* What the light that comes from a connection counts at the place of lane l's sample. */
static void add_connection(struct gather_work *w, uint32_t step, uint32_t l, const struct light_connection *c,
                           double weight)
{
    const struct tile_run_rays *r = w->rays;
    const struct kiln_vec3 normal = facet_of(r, l);
    const uint32_t j = r->point[l];
    const float shading = vec3_dot(frame_shading(&r->frame, j, normal), c->direction);
    const double irradiance = fmax(0.0, (double)shading) * weight,
                 incident = (double)(vec3_dot(normal, c->direction) * frame_taken_up(&r->frame, j, shading)) * weight;
    for (int i = 0; i < 3; i++) {
        w->irradiance[j][i] += irradiance * c->irradiance[i];
        w->incident[j][i] += incident * c->irradiance[i];
    }
    w->quarter[r->quarter_of[step * r->copies + r->copy[l]]][j] += irradiance * kiln_luminance(c->irradiance);
}

/* Connects the place of lane l's sample with a vertex of light. */
static void connect_place(struct gather_work *w, uint32_t step, uint32_t l)
{
    const struct tile_run_rays *r = w->rays;
    const struct kiln_caustic_techniques *t = w->techniques;
    const struct kiln_vec3 origin = origin_of(r, l);
    struct light_connection c;
    w->walk.key = kiln_chain_key(r->chance[l]);
    w->walk.k = rays_sample(r, step, l);
    if (!light_vertices_pick(&w->kept->of[r->quarter_of[step * r->copies + r->copy[l]]], &w->walk, CONNECTION_USE,
                             origin, &c))
        return;
    const double above = (double)vec3_dot(facet_of(r, l), c.direction);
    if (!(above > 0.0) || !light_vertices_connect(&c, &w->walk, origin))
        return;
    add_connection(w, step, l, &c,
                   kiln_caustic_weight_connected(t->mis, &c.light->sums, c.light->is_first, techniques_connections(t),
                                                 above / KILN_PI * c.far.cosine_o / c.squared, c.far.to_light,
                                                 c.far.to_eye * above / c.squared, (double)r->samples,
                                                 w->area[r->point[l]]));
}

/* What chains bring of lamps and sky, as radiosity; rays that meet nothing glossy bring nothing. */
static void collect_caustics(const struct embree_backend *b, struct embree_context *context, struct gather_work *w,
                             uint32_t step, uint32_t lanes)
{
    const struct tile_run_rays *r = w->rays;
    w->walk.context = context;
    for (uint32_t l = 0; l < lanes; l++) {
        float rgb[3];
        if (w->kept != NULL)
            connect_place(w, step, l);
        if (!is_chain(b, r, l))
            continue;
        if (w->weighed.pilot) {
            note_pilot(w, step, l);
            continue;
        }
        if (w->techniques != NULL)
            follow_weighed(w, step, l, r->samples);
        else
            follow(w, step, l, false);
        const float *light = w->techniques != NULL ? w->weighed.light[0] : w->chain.light;
        for (int c = 0; c < 3; c++)
            rgb[c] = light[c] * (float)KILN_PI;
        add(w, step, l, rgb, embree_tints(b));
    }
}

/* Adds what lamps bring by their images in flat mirrors. */
static void add_images(struct gather_work *w, struct embree_context *context)
{
    const double samples = (double)w->rays->samples;
    w->walk.context = context;
    for (uint32_t j = 0; j < w->rays->frame.count; j++) {
        struct image_light light;
        images_light(&w->walk, w->techniques->images, w->rays, j, &light);
        for (int c = 0; c < 3; c++) {
            w->incident[j][c] += samples * light.incident[c];
            w->irradiance[j][c] += samples * light.irradiance[c];
        }
        w->image_error[j] = samples * light.error;
    }
}

/* Harmonics may be negative; a point's light is not. */
static void raise_to_zero(struct gather_work *w)
{
    for (uint32_t j = 0; j < w->rays->frame.count; j++)
        for (int c = 0; c < 3; c++) {
            w->incident[j][c] = w->incident[j][c] < 0.0 ? 0.0 : w->incident[j][c];
            w->irradiance[j][c] = w->irradiance[j][c] < 0.0 ? 0.0 : w->irradiance[j][c];
        }
}

/* ---- the guide ---- */

/* What the pass does with the guide of a tile run: learns for it, or follows it. */
static void begin_guide(struct gather_work *w, const struct embree_backend *b, size_t tile_run)
{
    const struct kiln_surface *s = b->surface;
    const struct kiln_tile_run *run = &s->tile_runs[tile_run];
    const uint32_t side = kiln_guide_side(run->count);
    memset(w->square, 0, sizeof w->square);
    w->side = w->guided->learns ? side : 0;
    w->shift = side > 0 ? 32 - (uint32_t)__builtin_ctz(side) : 0;
    if (!w->guided->follows || side == 0 || s->guide == NULL)
        return;
    if (kiln_guide_make(w->guide, s->guide + KILN_GUIDE_FLOATS * kiln_own_of_global(s, run->first).at, side))
        w->rays->guide = w->guide;
}

/* Root mean squares, as if each cell had had its share of rays by the cosine. */
static void store_learnt(const struct gather_work *w, struct kiln_guided_result *results)
{
    const uint32_t cells = w->side * w->side;
    const double rays = (double)w->rays->frame.count * w->rays->samples / cells;
    for (uint32_t k = 0; k < cells; k++)
        results[k / KILN_GUIDE_FLOATS].learnt[k % KILN_GUIDE_FLOATS] = (float)sqrt(w->square[k] / rays);
}

/* ---- results ---- */

/* Standard error of the sum of point j. */
static float quarters_error(const struct gather_work *w, uint32_t j)
{
    double sum[RAY_QUARTERS];
    for (int i = 0; i < RAY_QUARTERS; i++)
        sum[i] = w->quarter[i][j];
    return rays_quarters_error(sum, w->rays->samples);
}

static struct kiln_point_result *result_of(const struct gather_work *w, void *results, uint32_t place)
{
    if (w->reference != NULL)
        return &((struct kiln_reference_result *)results)[place].point;
    return w->guided != NULL ? &((struct kiln_guided_result *)results)[place].point
                             : &((struct kiln_point_result *)results)[place];
}

static void store(const struct gather_work *w, void *results)
{
    for (uint32_t j = 0; j < w->rays->frame.count; j++) {
        struct kiln_point_result *r = result_of(w, results, w->rays->frame.place[j]);
        for (int c = 0; c < 3; c++) {
            r->incident[c] = (float)w->incident[j][c];
            r->irradiance[c] =
                w->rays->frame.smooth || w->rays->frame.glossy[j] ? (float)w->irradiance[j][c] : r->incident[c];
            r->glass[c] = (float)w->glass[j][c];
            r->gloss[c] = (float)w->gloss[j][c];
        }
        r->error = hypotf(quarters_error(w, j), (float)w->image_error[j]);
        r->present = w->rays->frame.present[j];
        r->escaped = (float)w->escaped[j];
        r->blocked = (float)w->blocked[j];
        r->count = w->rays->samples;
    }
}

static void clear_sums(struct gather_work *w)
{
    const size_t count = w->rays->frame.count;
    memset(w->plain, 0, sizeof w->plain);
    memset(w->incident, 0, count * sizeof *w->incident);
    memset(w->irradiance, 0, count * sizeof *w->irradiance);
    memset(w->glass, 0, count * sizeof *w->glass);
    memset(w->gloss, 0, count * sizeof *w->gloss);
    memset(w->escaped, 0, count * sizeof *w->escaped);
    memset(w->blocked, 0, count * sizeof *w->blocked);
    for (int i = 0; i < RAY_QUARTERS; i++)
        memset(w->quarter[i], 0, count * sizeof *w->quarter[i]);
}

/* Whether what a ray weighs does not hang on where it goes. */
static bool weighs_alike(const struct tile_run_frame *frame)
{
    bool alike = !frame->smooth;
    for (uint32_t j = 0; j < frame->count && alike; j++)
        alike = !frame->glossy[j];
    return alike;
}

static void find_kept(struct gather_work *w, const struct embree_backend *b, uint32_t step, uint32_t lanes)
{
    if (!kept_rows_find_chains(&w->rows)) /* else words are read where light is collected */
        kept_rows_find(&w->rows, b, w->rays, step, lanes, &w->found);
}

/* Finds what the rays of the step meet: traces them, or with `replays` looks it up. Returns the number of lanes. */
static uint32_t find_step(struct gather_work *w, const struct embree_backend *b, struct embree_context *context,
                          uint32_t step, bool replays, uint64_t *rays)
{
    if (replays && weighs_alike(&w->rays->frame)) { /* no sum hangs on where the rays go */
        const uint32_t lanes = rays_lanes(w->rays, step);
        find_kept(w, b, step, lanes);
        return lanes;
    }
    const uint32_t lanes = rays_make(w->rays, b, step);
    if (replays) {
        find_kept(w, b, step, lanes);
        return lanes;
    }
    *rays += b->probes != NULL ? end_rays(w, lanes) : lanes;
    if (w->directed != NULL)
        directed_aim(w->directed, w->rays, step, lanes);
    embree_trace_and_find(b, context, w->rays, lanes, &w->found);
    if (w->directed != NULL)
        directed_weigh(w->directed, w->rays, &w->found, lanes);
    kept_rows_note(&w->rows, w->rays, step, &w->found);
    return lanes;
}

static void gather_tile_run(void *work, const struct embree_backend *b, struct embree_context *context, size_t tile_run,
                            void *results, uint64_t *rays)
{
    struct gather_work *w = work;
    if (w->groups == NULL && kept_rows_replay(&w->rows, b, w->rays->batch, tile_run, results))
        return;
    const uint32_t steps = rays_begin(w->rays, b, tile_run, w->stream, 0);
    if (steps == 0) {
        (void)embree_group_run(b, tile_run);
        return;
    }
    clear_sums(w);
    if (w->groups != NULL)
        memset(w->groups, 0, w->rays->frame.count * group_sums(b) * sizeof *w->groups);
    if (w->guided != NULL)
        begin_guide(w, b, tile_run);
    if (b->probes != NULL)
        begin_probes(w, b, tile_run);
    if (w->directed != NULL)
        directed_begin(w->directed, w->rays, b, tile_run, w->stream);
    const bool plain = is_plain(w, b);
    const bool replays = kept_rows_read(&w->rows, b, tile_run, w->rays->frame.place, w->rays->frame.count),
               notes = kept_rows_note_chains(&w->rows);
    if (notes)
        kept_chains_begin(&w->rows.chains, w->rays->frame.count);
    for (uint32_t step = 0; step < steps; step++) {
        const uint32_t lanes = find_step(w, b, context, step, replays, rays);
        if (w->rays->frame.smooth && kept_rows_weighs(&w->rows))
            weigh(w, tile_run, step, lanes);
        if (replays && kept_rows_find_chains(&w->rows)) {
            collect_kept(b, w, step, lanes);
            continue;
        }
        if (b->probes != NULL || chain_any(b) || notes) {
            collect_lanes(b, context, w, step, lanes);
            continue;
        }
        count_lost(w);
        if (plain)
            collect_plain(b, w, step, lanes);
        else
            collect(b, w, step);
    }
    if (plain)
        take_plain(w);
    if (b->probes != NULL)
        raise_to_zero(w);
    if (replays && kept_rows_find_chains(&w->rows))
        take_lost(w);
    store(w, results);
    if (!replays)
        kept_rows_write(&w->rows, b, w->rays, tile_run, results);
    if (w->groups != NULL)
        store_groups(w, b, tile_run);
    if (w->side > 0)
        store_learnt(w, results);
}

static int gather_create(void **work, const struct embree_backend *b, const void *parameters,
                         const struct kiln_batch *part, struct kiln_error *error)
{
    int status = work_create(work, b, parameters, part, error);
    if (status != KILN_OK)
        return status;
    status = kept_rows_create(&((struct gather_work *)*work)->rows, b, part, error);
    if (status == KILN_OK)
        status = groups_create(*work, b, error);
    if (status != KILN_OK)
        work_destroy(work);
    return status;
}

int embree_gather(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                  uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {gather_create, work_destroy, gather_tile_run,
                                              sizeof(struct kiln_point_result)};
    const int status = embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
    struct kiln_rows *rows = b->base.rows;
    return status == KILN_OK && rows != NULL && rows->status != KILN_OK
               ? kiln_fail(error, rows->status, "%s", rows->error.message)
               : status;
}

int embree_guided(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                  uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {work_create, work_destroy, gather_tile_run,
                                              sizeof(struct kiln_guided_result)};
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}

/* ---- the directions pass ---- */

static int directions_create(void **work, const struct embree_backend *b, const void *parameters,
                             const struct kiln_batch *part, struct kiln_error *error)
{
    int status = work_create(work, b, NULL, part, error);
    if (status != KILN_OK)
        return status;
    struct gather_work *w = *work;
    w->directions = parameters;
    status = directed_create(&w->directed, w->directions, part, error);
    if (status != KILN_OK)
        work_destroy(work);
    return status;
}

int embree_directions(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                      uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {directions_create, work_destroy, gather_tile_run,
                                              sizeof(struct kiln_point_result)};
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}

/* ---- the caustic pass ---- */

/* Of passes that ask for the light of lamps: `stream` is added to the batch's. */
static int light_create(void **work, const struct embree_backend *b, const struct kiln_batch *part, uint32_t stream,
                        struct kiln_error *error)
{
    int status = work_create(work, b, NULL, part, error);
    if (status != KILN_OK)
        return status;
    struct gather_work *w = *work;
    w->stream = stream + part->stream;
    status = kiln_allocate(&w->choices, light_choices_room(b->params.lights), sizeof *w->choices, "the light choices",
                           error);
    w->walk.choices = w->choices;
    if (status != KILN_OK)
        work_destroy(work);
    return status;
}

static int caustic_create(void **work, const struct embree_backend *b, const void *parameters,
                          const struct kiln_batch *part, struct kiln_error *error)
{
    (void)parameters;
    return light_create(work, b, part, KILN_CAUSTIC_STREAM, error);
}

static void clear_pilot(struct gather_work *w)
{
    memset(w->pilot, 0, sizeof w->pilot);
    memset(w->squares, 0, sizeof w->squares);
    memset(w->exchanges, 0, sizeof w->exchanges);
    memset(w->products, 0, sizeof w->products);
}

static void caustic_tile_run(void *work, const struct embree_backend *b, struct embree_context *context,
                             size_t tile_run, void *results, uint64_t *rays)
{
    struct gather_work *w = work;
    const uint32_t steps = rays_begin(w->rays, b, tile_run, w->stream, 0);
    if (steps == 0)
        return;
    clear_sums(w);
    w->weighed.pilot = w->techniques != NULL && w->techniques->moments != NULL;
    if (w->weighed.pilot)
        clear_pilot(w);
    if (w->techniques != NULL)
        find_areas(w, b, tile_run);
    for (uint32_t step = 0; step < steps; step++) {
        const uint32_t lanes = rays_make(w->rays, b, step);
        *rays += lanes;
        rays_trace(w->rays, b, context, lanes);
        collect_caustics(b, context, w, step, lanes);
    }
    if (w->weighed.pilot)
        store_moments(w, b, tile_run);
    memset(w->glass, 0, sizeof w->glass); /* of what gather rays find */
    if (w->techniques != NULL && w->techniques->images != NULL && !w->weighed.pilot)
        add_images(w, context);
    store(w, results);
}

int embree_caustic(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                   uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {caustic_create, work_destroy, caustic_tile_run,
                                              sizeof(struct kiln_point_result)};
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}

static int weighed_create(void **work, const struct embree_backend *b, const void *parameters,
                          const struct kiln_batch *part, struct kiln_error *error)
{
    const int status = caustic_create(work, b, NULL, part, error);
    if (status == KILN_OK) {
        ((struct gather_work *)*work)->techniques = parameters;
        ((struct gather_work *)*work)->kept = b->light_vertices;
    }
    return status;
}

int embree_weighed(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                   uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {weighed_create, work_destroy, caustic_tile_run,
                                              sizeof(struct kiln_point_result)};
    const int status = light_vertices_want(b, parameters, error);
    if (status != KILN_OK)
        return status;
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}

/* ---- the reference pass ---- */

static int reference_create(void **work, const struct embree_backend *b, const void *parameters,
                            const struct kiln_batch *part, struct kiln_error *error)
{
    const int status = light_create(work, b, part, KILN_REFERENCE_STREAM, error);
    if (status == KILN_OK) {
        struct gather_work *w = *work;
        w->reference = parameters;
        w->paths = b->reference;
    }
    return status;
}

/* What of the light that the ray of lane l finds counts as incident. */
static float incident_weight(const struct gather_work *w, uint32_t l)
{
    const struct tile_run_rays *r = w->rays;
    const uint32_t j = r->point[l];
    const struct kiln_vec3 shading = frame_shading(&r->frame, j, vec3(r->facet[0][l], r->facet[1][l], r->facet[2][l]));
    const float cosine = r->frame.smooth ? vec3_dot(shading, direction_of(r, l)) : r->cosine[l];
    return facet_weight(r, l) * frame_taken_up(&r->frame, j, cosine);
}

/* Counts what becomes of the ray of lane l that has met a surface, up to the diffuse parts that it finds. */
static void count_ends(struct gather_work *w, const struct embree_backend *b, uint32_t step, uint32_t l, bool tints)
{
    struct kiln_light_choice *choices = w->walk.choices;
    if (!chain_begins_at(b, w->rays, l))
        return;
    w->walk.choices = NULL; /* lights are not asked for */
    follow(w, step, l, false);
    w->walk.choices = choices;
    count_chain(w, l, tints);
}

/* What lane l's sample brings by its ray and, by connections, beside it. `ray`: what its ray has met; NULL: nothing
 * that goes on. */
static void find_paths(struct gather_work *w, uint32_t step, uint32_t l, const struct RTCRayHit *ray,
                       struct reference_found *found)
{
    const struct tile_run_rays *r = w->rays;
    if (w->reference->method != KILN_REFERENCE_PATH) {
        reference_follow(&w->subpaths, w->paths, r, step, l, w->receives_only, ray, found);
        return;
    }
    memset(found, 0, sizeof *found);
    if (ray != NULL)
        path_follow(&w->walk, kiln_chain_key(r->chance[l]), rays_sample(r, step, l), w->reference->bounces, ray,
                    found->radiance, found->last);
}

static void add_paths(struct gather_work *w, uint32_t step, uint32_t l, const struct reference_found *found, bool tints)
{
    const struct tile_run_rays *r = w->rays;
    const uint32_t j = r->point[l];
    float rgb[3];
    for (int c = 0; c < 3; c++) {
        const float last = incident_weight(w, l) * found->last[c] * (float)KILN_PI * (tints ? r->tint[l][c] : 1.0f);
        rgb[c] = found->radiance[c] * (float)KILN_PI;
        w->last[j][c] += (double)last + found->last_incident[c];
        w->irradiance[j][c] += found->irradiance[c];
        w->incident[j][c] += found->incident[c];
    }
    add(w, step, l, rgb, tints);
    w->quarter[r->quarter_of[step * r->copies + r->copy[l]]][j] += kiln_luminance(found->irradiance);
}

/* As collect_lanes: what paths bring, lane by lane. */
static void collect_paths(const struct embree_backend *b, struct embree_context *context, struct gather_work *w,
                          uint32_t step, uint32_t lanes)
{
    const bool tints = embree_tints(b);
    w->walk.context = context;
    memset(w->lost, 0, sizeof w->lost);
    w->found.escaped = w->found.blocked = 0;
    for (uint32_t l = 0; l < lanes; l++) {
        const struct RTCRayHit ray = rays_lane(w->rays, l);
        const bool meets = ray.hit.geomID != RTC_INVALID_GEOMETRY_ID,
                   arrives = meets && meeting_has_side(b, meeting_record(b, &ray), meeting_is_back(&ray)),
                   goes_on = arrives && facet_weight(w->rays, l) > 0.0f;
        struct reference_found found;
        if (!meets)
            w->found.escaped_lane[w->found.escaped++] = (uint8_t)l;
        else if (!arrives)
            w->found.blocked_lane[w->found.blocked++] = (uint8_t)l;
        find_paths(w, step, l, goes_on ? &ray : NULL, &found);
        if (goes_on)
            count_ends(w, b, step, l, tints);
        add_paths(w, step, l, &found, tints && goes_on);
    }
    count_lost_in_order(w, lanes);
}

static void reference_tile_run(void *work, const struct embree_backend *b, struct embree_context *context,
                               size_t tile_run, void *results, uint64_t *rays)
{
    struct gather_work *w = work;
    const struct kiln_surface *s = b->surface;
    const uint32_t steps = rays_begin(w->rays, b, tile_run, w->stream, 0),
                   object = kiln_map_object(s, s->tile_runs[tile_run].map);
    if (steps == 0)
        return;
    clear_sums(w);
    memset(w->last, 0, sizeof w->last);
    w->walk.rays = w->subpaths.rays = 0;
    w->subpaths.context = *context;
    w->receives_only = (b->params.scene->objects[object].flags & KILN_OBJECT_RECEIVER_ONLY) != 0;
    for (uint32_t step = 0; step < steps; step++) {
        const uint32_t lanes = rays_make(w->rays, b, step);
        *rays += lanes;
        rays_trace(w->rays, b, context, lanes);
        collect_paths(b, context, w, step, lanes);
    }
    *rays += w->walk.rays + w->subpaths.rays;
    if (w->subpaths.status != KILN_OK) {
#pragma omp critical(kiln_reference_status)
        {
            w->paths->status = w->subpaths.status;
            w->paths->error = w->subpaths.error;
        }
    }
    store(w, results);
    for (uint32_t j = 0; j < w->rays->frame.count; j++)
        for (int c = 0; c < 3; c++)
            ((struct kiln_reference_result *)results)[w->rays->frame.place[j]].last[c] = (float)w->last[j][c];
}

int embree_reference(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                     uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {reference_create, work_destroy, reference_tile_run,
                                              sizeof(struct kiln_reference_result)};
    const int status = reference_paths_want(b, parameters, part, error);
    if (status != KILN_OK)
        return status;
    b->reference->status = KILN_OK;
    const int traced = embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
    return traced == KILN_OK && b->reference->status != KILN_OK
               ? kiln_fail(error, b->reference->status, "%s", b->reference->error.message)
               : traced;
}
