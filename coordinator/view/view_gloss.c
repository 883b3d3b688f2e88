#include "coordinator/view/view_gloss.h"

#include <math.h>

#include "coordinator/view/view_grain.h"
#include "coordinator/view/view_lamps.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/material/scene_lobes.h"
#include "worker/sampling/keys.h"
#include "worker/scene/footprint.h"
#include "worker/scene/texture.h"

/* Limits. BAND_RAYS: rays traced together. LIT_PLACES: their surfaces that are lit by lamps together, some 700 bytes
 * each. MOST_SURFACES: surfaces from which a ray goes on. KEY: key of the random numbers. PARTINGS: number of smooth
 * glass surfaces at which a ray splits into reflection and refraction; each split adds walkers, if both branches have a
 * weight of at least least_parted. */
enum { BAND_RAYS = 1 << 16, LIT_PLACES = 1 << 13, MOST_SURFACES = 64, KEY = 0x76696577 };
enum { PARTINGS = 2, WALKERS = 1 << PARTINGS };
static const float least_parted = 1.0f / 128.0f;

/* TIMES: rays through each subpixel; in previews, which have 2 x 2 subpixels, one. */
enum { TIMES = 4, PREVIEW_SIDE = 2 };

/* Pixels for training the guides, which get as many rays as in the picture. APART_LEAST: least distance of such pixels
 * along rows and columns. LESSON_PIXELS: largest number of them, about. */
enum { APART_LEAST = 4, LESSON_PIXELS = 1 << 15 };

/* A ray being followed, and the light that it has collected. */
struct walker {
    uint32_t key, number;
    float weight[3], rgb[3];
    uint32_t place, partings; /* index among the walkers of its ray; number of splits so far */
    bool parts;               /* it has just done so */
    bool rough;               /* it has met a rough lobe: later light is grain, as in */
    float grain[3], share[3], alpha;
    struct kiln_vec3 normal, position; /* struct kiln_view_grain */
    bool goes_on, lit;                 /* `lit`: the last surface has gloss */
    struct kiln_vec3 origin, direction;
    struct kiln_view_way way;
    /* the departure from the first surface with rough gloss: its region, the weight of light that reaches the eye from
     * there, and the hit found beyond */
    uint32_t region; /* KILN_NONE: it has met none */
    bool leaves;     /* it has just left that surface */
    struct kiln_vec3 found;
    float weight_there, beyond;
};

struct kiln_view_gloss {
    const struct kiln_view_params *params;
    struct kiln_view_maps *maps;
    struct kiln_view_rays *rays;
    struct walker *walkers;  /* WALKERS per ray; the first exists from the beginning, the others after splits */
    uint32_t *active, *next; /* indices of the walkers being traced; those of the next step */
    struct kiln_gloss_lobes *lobes;
    struct kiln_view_lamps *lamps;
    struct kiln_view_guides *guides;
    struct kiln_view_lit *lit;      /* surfaces with gloss that they have met, at most LIT_PLACES at once */
    uint32_t *lit_of;               /* the walkers of these */
    uint32_t side, each;            /* subpixels along a side of a pixel; rays of a pixel, in turn over all subpixels */
    uint32_t first;                 /* those of them that come first */
    bool learns;                    /* the rays train the guides */
    size_t part;                    /* pixels that there is room for */
    struct kiln_view_grain *grains; /* of the pixels that were drawn */
    size_t grain_count, grain_capacity;
    struct kiln_arena arena;
};

static uint32_t spread_bits(uint32_t x)
{
    x = (x | x << 8) & 0x00ff00ffu;
    x = (x | x << 4) & 0x0f0f0f0fu;
    x = (x | x << 2) & 0x33333333u;
    return (x | x << 1) & 0x55555555u;
}

/* Starts ray `number` of a pixel; `key` selects the random numbers. All rays of a picture use one sequence, in Morton
 * order of their pixels. The rays of any square of pixels whose side is a power of two are then evenly distributed, and
 * their noise differs between neighbours, so that a filter can remove it (Ahmed and Wonka, "Screen-Space Blue-Noise
 * Diffusion of Monte Carlo Sampling Error via Hierarchical Ordering of Pixels", ACM TOG 39(6), 2020). */
static void start(const struct kiln_view_gloss *b, uint32_t key, size_t pixel, uint32_t number, struct walker *w)
{
    const struct kiln_view_params *p = b->params;
    const uint32_t place = number % (b->side * b->side);
    const uint32_t x = (uint32_t)(pixel % p->width), y = (uint32_t)(pixel / p->width);
    *w = (struct walker){.key = key,
                         .number = (spread_bits(x & 0xffffu) | spread_bits(y & 0xffffu) << 1) * b->each + number,
                         .weight = {1.0f, 1.0f, 1.0f},
                         .region = KILN_NONE,
                         .goes_on = true};
    kiln_view_ray(p, (double)(pixel % p->width) + ((double)(place % b->side) + 0.5) / b->side,
                  (double)(pixel / p->width) + ((double)(place / b->side) + 0.5) / b->side, &w->origin, &w->direction);
}

static void add(struct walker *w, const float factor[3], const float rgb[3])
{
    for (int c = 0; c < 3; c++) {
        const float light = w->weight[c] * factor[c] * rgb[c];
        (w->rough ? w->grain : w->rgb)[c] += light;
        w->beyond += w->region != KILN_NONE ? light : 0.0f;
    }
}

/* Hit of a ray, and the surface there if it has gloss. */
struct met {
    struct kiln_hit hit;
    bool gloss; /* else only this and the hit are set */
    struct kiln_particle_place place;
    float radiosity[3], emission[3]; /* W/(m2 sr): radiance by its diffuse part, were all light taken up; emission */
};

/* Finds the diffuse and emitted radiance of the glossy surface, from its lightmap and as a lamp. */
static void find_own(const struct kiln_view_gloss *b, struct met *met)
{
    const struct kiln_hit *hit = &met->hit;
    const struct kiln_view_source *s = &b->params->source;
    const struct kiln_geometry *g = s->geometry;
    const struct kiln_mesh *mesh = &s->scene->meshes[s->scene->objects[g->records[hit->triangle].object].mesh];
    const uint64_t stored = g->stored_triangle[hit->triangle];
    float color[3], b1, b2;
    kiln_geometry_stored_barycentrics(s->scene, g, hit->triangle, hit->u, hit->v, &b1, &b2);
    kiln_surface_albedo(s->scene, mesh, stored, b1, b2, color);
    kiln_surface_emission(s->scene, mesh, stored, b1, b2, met->emission);
    kiln_view_irradiance(b->maps, hit, met->radiosity);
    for (int c = 0; c < 3; c++)
        met->radiosity[c] *= color[c] * (float)(1.0 / KILN_PI);
}

static void add_own(const struct met *met, const struct kiln_particle_turn *turn, double share, struct walker *w)
{
    float emission[3];
    for (int c = 0; c < 3; c++)
        emission[c] = met->emission[c] * (float)share;
    add(w, turn->taken_up, met->radiosity);
    add(w, met->place.arrives, emission);
}

/* Finds the hit of ray number `ray`, in `direction`. */
static void find_met(const struct kiln_view_gloss *b, size_t ray, struct kiln_vec3 direction, struct met *met)
{
    met->hit = b->rays->hits[ray];
    met->gloss = kiln_view_goes_on(&b->params->source, &met->hit);
    if (!met->gloss)
        return;
    struct kiln_hit whole = met->hit;
    whole.distance += b->rays->passed[ray];
    met->place = kiln_particle_place(&b->params->source.backend->params, b->lobes, &whole, direction);
    find_own(b, met);
}

/* Adds the light at the end of the ray: that of a surface without gloss, or of the environment. */
static void add_seen(const struct kiln_view_gloss *b, const struct kiln_hit *hit, struct kiln_vec3 direction,
                     double share, struct walker *w)
{
    struct kiln_view_seen seen;
    float emission[3];
    kiln_view_radiance(b->maps, hit, direction, &seen);
    if (share < 1.0 && hit->triangle == KILN_NONE)
        for (int c = 0; c < 3; c++)
            seen.rgb[c] *= (float)share;
    else if (share < 1.0) {
        kiln_view_emission(b->maps, hit, emission);
        for (int c = 0; c < 3; c++)
            seen.rgb[c] -= (float)(1.0 - share) * hit->tint[c] * emission[c];
    }
    add(w, (const float[3]){1.0f, 1.0f, 1.0f}, seen.rgb);
}

/* Begins the grain: later light of the walker comes by the rough lobes of this place. */
static void become_rough(const struct kiln_particle_place *place, struct walker *w)
{
    const struct kiln_bsdf_albedo a = kiln_bsdf_albedo_of(place->lobes, place->o);
    const struct kiln_vec3 sum = vec3_add(vec3_add(a.gloss, a.coat), vec3_add(a.spread_near, a.spread_far));
    w->rough = true;
    w->share[0] = w->weight[0] * place->arrives[0] * sum.x;
    w->share[1] = w->weight[1] * place->arrives[1] * sum.y;
    w->share[2] = w->weight[2] * place->arrives[2] * sum.z;
    w->alpha = fmaxf(place->lobes.alpha_x, place->lobes.alpha_y);
    w->normal = vec3_scale(place->frame.z, place->hit.back ? -1.0f : 1.0f);
    w->position = place->position;
}

/* Sends a walker on. */
static void leave(struct walker *w, const struct kiln_particle_place *place, const struct kiln_particle_turn *turn)
{
    w->goes_on = false;
    for (int c = 0; c < 3; c++) {
        w->weight[c] *= turn->goes_on[c];
        w->goes_on = w->goes_on || w->weight[c] > 0.0f;
    }
    w->origin = turn->origin;
    w->direction = turn->direction;
    w->way = kiln_view_way(place, turn);
}

static float largest(const float a[3], const float b[3]) { return fmaxf(a[0] * b[0], fmaxf(a[1] * b[1], a[2] * b[2])); }

/* Splits a walker at smooth glass: it takes one of reflection and refraction, and a new walker takes the other. False:
 * no split. */
static bool part(const struct kiln_view_gloss *b, const struct met *met, const struct kiln_view_lit *lit, double share,
                 struct walker *w)
{
    struct kiln_particle_turn turns[2];
    if (b->learns || w->rough || w->partings == PARTINGS || !kiln_particle_part(&lit->place, &lit->chance, turns) ||
        fminf(largest(w->weight, turns[0].goes_on), largest(w->weight, turns[1].goes_on)) < least_parted)
        return false;
    add_own(met, &turns[0], share, w);
    const uint32_t place = w->place | 1u << w->partings++;
    struct walker *other = w + (place - w->place);
    *other = *w;
    other->place = place;
    for (int c = 0; c < 3; c++)
        other->rgb[c] = other->grain[c] = other->share[c] = 0.0f;
    leave(w, &lit->place, &turns[1]);
    leave(other, &lit->place, &turns[0]);
    w->parts = true;
    return true;
}

/* Processes the hit of walker w's ray. `lit`: the surface, if it has gloss. */
static void meet(const struct kiln_view_gloss *b, const struct met *met, float passed, struct kiln_vec3 direction,
                 uint32_t surface, struct walker *w, struct kiln_view_lit *lit)
{
    const struct kiln_hit *hit = &met->hit;
    if (w->leaves && hit->triangle != KILN_NONE)
        w->found = kiln_triangle_position(b->params->source.geometry, hit->triangle, hit->u, hit->v);
    else if (w->leaves)
        w->found = vec3_madd(w->origin, direction, kiln_view_guides_far(b->guides));
    w->leaves = false;
    /* a view hides some surfaces, which light samples do not pass: beyond them rays bring all the light */
    const double share = passed > 0.0f ? 1.0 : kiln_view_lamps_share(b->lamps, &w->way, hit, direction);
    w->goes_on = w->parts = false;
    w->lit = met->gloss;
    if (!w->lit) {
        add_seen(b, hit, direction, share, w);
        return;
    }
    for (int c = 0; c < 3; c++)
        w->weight[c] *= hit->tint[c];
    lit->place = met->place;
    lit->chance = (struct kiln_particle_chance){.key = w->key, .number = w->number, .surface = surface};
    for (int c = 0; c < 3; c++) {
        lit->weight[c] = w->weight[c];
        lit->rgb[c] = 0.0f;
    }
    if (part(b, met, lit, share, w))
        return;
    const uint32_t region = kiln_view_guides_region(b->guides, &lit->place, &lit->chance);
    lit->guide = kiln_view_guides_at(b->guides, region, &lit->place);
    const struct kiln_particle_turn turn = kiln_view_guide_turn(&lit->guide, &lit->place, w->weight, &lit->chance);
    add_own(met, &turn, share, w);
    if (!w->rough && !kiln_particle_is_smooth(&lit->place))
        become_rough(&lit->place, w);
    if (w->region == KILN_NONE && !turn.mirrored) {
        w->region = region;
        w->leaves = region != KILN_NONE;
        w->weight_there = w->weight[0] + w->weight[1] + w->weight[2];
    }
    leave(w, &lit->place, &turn);
}

/* Adds the light of lamps at the glossy surfaces that active walkers [first, first + count) have met. */
static int add_lamps(struct kiln_view_gloss *b, size_t first, size_t count, struct kiln_error *error)
{
    size_t lit = 0;
    for (size_t i = 0; i < count; i++) {
        if (!b->walkers[b->active[first + i]].lit)
            continue;
        b->lit[lit] = b->lit[i];
        b->lit_of[lit++] = b->active[first + i];
    }
    const int status = kiln_view_lamps_add(b->lamps, b->lit, lit, error);
    for (size_t i = 0; i < lit && status == KILN_OK; i++) /* mirrors and smooth glass get no light from samples */
        for (int c = 0; c < 3; c++)
            b->walkers[b->lit_of[i]].grain[c] += b->lit[i].rgb[c];
    return status;
}

/* Processes the hits of active walkers [first, first + count), at most LIT_PLACES. */
static int meet_some(struct kiln_view_gloss *b, size_t first, size_t count, uint32_t surface, struct kiln_error *error)
{
#pragma omp parallel for schedule(dynamic, 64)
    for (size_t i = 0; i < count; i++) {
        const struct kiln_vec3 direction = b->rays->directions[first + i];
        struct met met;
        find_met(b, first + i, direction, &met);
        meet(b, &met, b->rays->passed[first + i], direction, surface, &b->walkers[b->active[first + i]], &b->lit[i]);
    }
    return add_lamps(b, first, count, error);
}

/* Compacts the first `count` active walkers to those that go on, each followed by the walker split off from it. Returns
 * their number. */
static size_t go_on(struct kiln_view_gloss *b, size_t count)
{
    uint32_t *const before = b->active;
    size_t left = 0;
    for (size_t i = 0; i < count; i++) {
        const uint32_t at = before[i];
        const struct walker *w = &b->walkers[at];
        const uint32_t other = w->parts ? 1u << (w->partings - 1) : 0;
        if (w->goes_on)
            b->next[left++] = at;
        if (other != 0 && w[other].goes_on)
            b->next[left++] = at + other;
    }
    b->active = b->next;
    b->next = before;
    return left;
}

/* Traces the first `count` active walkers to their next surface. *count becomes the number that go on. */
static int step(struct kiln_view_gloss *b, size_t *count, uint32_t surface, struct kiln_error *error)
{
    struct kiln_view_rays *rays = b->rays;
    for (size_t i = 0; i < *count; i++) {
        rays->origins[i] = b->walkers[b->active[i]].origin;
        rays->directions[i] = b->walkers[b->active[i]].direction;
    }
    int status;
    KILN_TRY(kiln_view_trace(&b->params->source, rays, *count, error));
    KILN_TRY(kiln_view_maps_load(b->maps, rays->hits, *count, error));
    for (size_t i = 0; i < *count; i += LIT_PLACES)
        KILN_TRY(meet_some(b, i, *count - i < LIT_PLACES ? *count - i : LIT_PLACES, surface, error));
    *count = go_on(b, *count);
end:
    return status;
}

/* Appends rays [from, to) of the i-th pixel in progress to the active walkers. Returns the new number of these. */
static size_t list_rays(struct kiln_view_gloss *b, size_t i, uint32_t from, uint32_t to, size_t active)
{
    for (uint32_t k = from; k < to; k++)
        b->active[active++] = (uint32_t)((i * b->each + k) * WALKERS);
    return active;
}

/* Traces the listed rays, and the walkers split off from them, to their ends. */
static int follow(struct kiln_view_gloss *b, uint32_t key, const size_t *pixels, size_t active,
                  struct kiln_error *error)
{
    const size_t rays = b->each;
    int status = KILN_OK;
#pragma omp parallel for schedule(dynamic, 1024)
    for (size_t i = 0; i < active; i++) {
        const size_t ray = b->active[i] / WALKERS;
        start(b, key, pixels[ray / rays], (uint32_t)(ray % rays), &b->walkers[b->active[i]]);
    }
    for (uint32_t surface = 0; surface < MOST_SURFACES && active > 0 && status == KILN_OK; surface++)
        status = step(b, &active, surface, error);
    return status;
}

/* Adds a walker's light, times `part`, to `rgb` and the grain. `found`: counts walkers that have met rough lobes. */
static void add_ray(const struct walker *w, float part, float rgb[3], struct kiln_view_grain *grain, uint32_t *found)
{
    for (int c = 0; c < 3; c++) {
        rgb[c] += part * w->rgb[c];
        grain->light[c] += part * w->grain[c];
        grain->share[c] += part * w->share[c];
    }
    if (w->rough) {
        grain->normal = vec3_add(grain->normal, w->normal);
        grain->position = vec3_add(grain->position, w->position);
        grain->alpha += w->alpha;
        (*found)++;
    }
}

static float grain_luminance(const struct kiln_view_grain *grain)
{
    return kiln_rgb_luminance(grain->light[0], grain->light[1], grain->light[2]);
}

/* Adds up all rays of a pixel. Returns whether any has met rough lobes. */
static bool add_pixel(const struct walker *walkers, uint32_t rays, float rgb[3], struct kiln_view_grain *grain)
{
    const float part = 1.0f / (float)rays;
    uint32_t found = 0;
    double squares = 0.0;
    for (uint32_t k = 0; k < rays; k++, walkers += WALKERS) {
        const double before = (double)grain_luminance(grain);
        const bool second = walkers[0].partings > 0;
        add_ray(&walkers[0], part, rgb, grain, &found);
        if (second)
            add_ray(&walkers[1], part, rgb, grain, &found);
        if (walkers[0].partings > 1)
            add_ray(&walkers[2], part, rgb, grain, &found);
        if (second && walkers[1].partings > 1)
            add_ray(&walkers[3], part, rgb, grain, &found);
        const double own = (double)grain_luminance(grain) - before;
        squares += own * own;
    }
    if (found == 0)
        return false;
    const float length = vec3_length(grain->normal);
    grain->normal = vec3_scale(grain->normal, length > 0.0f ? 1.0f / length : 0.0f);
    grain->position = vec3_scale(grain->position, 1.0f / (float)found);
    grain->alpha /= (float)found;
    const double sum = (double)grain_luminance(grain), count = (double)rays;
    grain->variance = rays > 1 ? (float)(fmax(0.0, squares - sum * sum / count) * count / (count - 1.0)) : -1.0f;
    return true;
}

/* Whether any walker of a ray has met rough lobes. */
static bool is_rough(const struct walker *w)
{
    bool rough = w[0].rough;
    rough = rough || (w[0].partings > 0 && w[1].rough);
    rough = rough || (w[0].partings > 1 && w[2].rough);
    return rough || (w[0].partings > 0 && w[1].partings > 1 && w[3].rough);
}

/* Adds up the first `rays` rays of the i-th pixel in progress. */
static void finish(struct kiln_view_gloss *b, size_t i, size_t pixel, uint32_t rays, float rgb[3])
{
    struct kiln_view_grain grain = {.pixel = pixel};
    for (size_t c = 0; c < 3; c++)
        rgb[c] = 0.0f;
    if (add_pixel(&b->walkers[i * b->each * WALKERS], rays, rgb, &grain))
        b->grains[b->grain_count++] = grain;
}

static int make_room(struct kiln_view_gloss *b, size_t count, struct kiln_error *error)
{
    return kiln_arena_grow(&b->arena, &b->grains, &b->grain_capacity, b->grain_count + count, sizeof *b->grains,
                           "the grain of a view", error);
}

/* Draws `count` pixels, at most b->part. */
static int draw(struct kiln_view_gloss *b, const size_t *pixels, size_t count, float *rgb, bool *done,
                struct kiln_error *error)
{
    size_t active = 0;
    int status = make_room(b, count, error);
    for (size_t i = 0; i < count; i++)
        active = list_rays(b, i, 0, done[i] ? b->each : b->first, active);
    if (status == KILN_OK)
        status = follow(b, KEY, pixels, active, error);
    active = 0;
    KILN_TRY(status);
    for (size_t i = 0; i < count; i++) {
        const bool was_done = done[i];
        done[i] = was_done || b->first == b->each || is_rough(&b->walkers[i * b->each * WALKERS]);
        if (done[i] && !was_done)
            active = list_rays(b, i, b->first, b->each, active);
    }
    KILN_TRY(follow(b, KEY, pixels, active, error));
    for (size_t i = 0; i < count; i++)
        finish(b, i, pixels[i], done[i] ? b->each : b->first, rgb + 3 * i);
end:
    return status;
}

/* Draws the rays that `draw` has left out, for as many pixels. */
static int draw_rest(struct kiln_view_gloss *b, const size_t *pixels, size_t count, float *rgb,
                     struct kiln_error *error)
{
    size_t active = 0;
    int status = make_room(b, count, error);
    for (size_t i = 0; i < count; i++) { /* only previews have a rest, after one ray */
        b->walkers[i * b->each * WALKERS] = (struct walker){.rgb = {rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]}};
        active = list_rays(b, i, b->first, b->each, active);
    }
    if (status == KILN_OK)
        status = follow(b, KEY, pixels, active, error);
    for (size_t i = 0; i < count && status == KILN_OK; i++)
        finish(b, i, pixels[i], b->each, rgb + 3 * i);
    return status;
}

/* ---- guides ---- */

/* Grid of pixels that train the guides, if they see gloss. */
struct grid {
    size_t apart, wide, all; /* distance, pixels; number of them in a row, and in all */
};
static struct grid lesson_grid(const struct kiln_view_params *p)
{
    const double fewest = ceil(sqrt((double)p->width * (double)p->height / LESSON_PIXELS));
    struct grid g = {.apart = fewest > APART_LEAST ? (size_t)fewest : APART_LEAST};
    g.wide = (p->width + g.apart - 1) / g.apart;
    g.all = g.wide * ((p->height + g.apart - 1) / g.apart);
    return g;
}

/* Trains the guides with the rays of `count` pixels, at most b->part. Ends early if none of the first rays meets rough
 * gloss. */
static int learn_some(struct kiln_view_gloss *b, const size_t *pixels, size_t count, struct kiln_error *error)
{
    const uint32_t rays = b->each;
    size_t active = 0;
    bool some = false;
    for (size_t i = 0; i < count; i++)
        active = list_rays(b, i, 0, b->first, active);
    int status = follow(b, ~(uint32_t)KEY, pixels, active, error);
    for (size_t i = 0; i < count && status == KILN_OK; i++)
        for (uint32_t k = 0; k < b->first; k++)
            some = some || b->walkers[(i * rays + k) * WALKERS].region != KILN_NONE;
    active = 0;
    for (size_t i = 0; i < count && some; i++)
        active = list_rays(b, i, b->first, rays, active);
    if (status == KILN_OK)
        status = follow(b, ~(uint32_t)KEY, pixels, active, error);
    for (size_t i = 0; i < count * rays && some && status == KILN_OK; i++) {
        const struct walker *w = &b->walkers[i * WALKERS];
        kiln_view_guides_learn(b->guides, w->region, w->found, w->beyond / w->weight_there);
    }
    return status;
}

/* Moves the pixels to the front that see gloss at their centre. *count becomes their number. */
static int keep_gloss(struct kiln_view_gloss *b, size_t *pixels, size_t *count, struct kiln_error *error)
{
    size_t kept = 0;
    for (size_t i = 0; i < *count; i++)
        kiln_view_ray(b->params, (double)(pixels[i] % b->params->width) + 0.5,
                      (double)(pixels[i] / b->params->width) + 0.5, &b->rays->origins[i], &b->rays->directions[i]);
    const int status = kiln_view_trace(&b->params->source, b->rays, *count, error);
    for (size_t i = 0; i < *count && status == KILN_OK; i++)
        if (kiln_view_goes_on(&b->params->source, &b->rays->hits[i]))
            pixels[kept++] = pixels[i];
    *count = kept;
    return status;
}

/* Trains the guides with rays all over the picture. */
static int learn(struct kiln_view_gloss *b, struct kiln_error *error)
{
    const struct grid grid = lesson_grid(b->params);
    size_t *pixels = NULL;
    int status = kiln_allocate(&pixels, b->part, sizeof *pixels, "guides of a view", error);
    b->learns = true;
    for (size_t i = 0; i < grid.all && status == KILN_OK; i += b->part) {
        size_t count = 0;
        for (size_t k = i; k < i + b->part && k < grid.all; k++)
            pixels[count++] = (k / grid.wide * b->params->width + k % grid.wide) * grid.apart;
        status = keep_gloss(b, pixels, &count, error);
        if (status == KILN_OK)
            status = learn_some(b, pixels, count, error);
    }
    kiln_free(&pixels);
    b->learns = false;
    if (status == KILN_OK)
        kiln_view_guides_finish(b->guides);
    return status;
}

int kiln_view_gloss_create(struct kiln_view_gloss **gloss, const struct kiln_view_params *params,
                           struct kiln_view_maps *maps, struct kiln_error *error)
{
    int status = kiln_allocate(gloss, 1, sizeof **gloss, "rays of a view", error);
    if (status != KILN_OK)
        return status;
    struct kiln_view_gloss *b = *gloss;
    const uint32_t side = params->side, rays = side * side * (side < 4 ? 1 : TIMES);
    *b = (struct kiln_view_gloss){
        .params = params, .maps = maps, .side = side, .each = rays, .first = side == PREVIEW_SIDE ? 1 : rays};
    b->part = rays * WALKERS < BAND_RAYS ? BAND_RAYS / (rays * WALKERS) : 1;
    const size_t walkers = b->part * rays * WALKERS;
    KILN_TRY(kiln_view_rays_create(&b->rays, walkers, error));
    KILN_TRY(kiln_arena_allocate(&b->arena, &b->walkers, walkers, sizeof *b->walkers, "rays of a view", error));
    KILN_TRY(kiln_allocate(&b->active, walkers, sizeof *b->active, "rays of a view", error));
    KILN_TRY(kiln_allocate(&b->next, walkers, sizeof *b->next, "rays of a view", error));
    KILN_TRY(kiln_arena_allocate(&b->arena, &b->lit, LIT_PLACES, sizeof *b->lit, "rays of a view", error));
    KILN_TRY(kiln_arena_allocate(&b->arena, &b->lit_of, LIT_PLACES, sizeof *b->lit_of, "rays of a view", error));
    KILN_TRY(kiln_view_lamps_create(&b->lamps, &params->source, LIT_PLACES, error));
    KILN_TRY(kiln_scene_lobes(&b->lobes, params->source.scene, error));
    KILN_TRY(kiln_view_guides_create(&b->guides, params->source.geometry, rays * lesson_grid(params).all, error));
    KILN_TRY(learn(b, error));
end:
    if (status != KILN_OK)
        kiln_view_gloss_destroy(gloss);
    return status;
}

void kiln_view_gloss_destroy(struct kiln_view_gloss **gloss)
{
    struct kiln_view_gloss *b = *gloss;
    if (b == NULL)
        return;
    kiln_view_rays_destroy(&b->rays);
    kiln_free(&b->active);
    kiln_free(&b->next);
    kiln_arena_release(&b->arena);
    kiln_view_lamps_destroy(&b->lamps);
    kiln_view_guides_destroy(&b->guides);
    kiln_free(&b->lobes);
    kiln_free(gloss);
}

int kiln_view_gloss_draw(struct kiln_view_gloss *gloss, const size_t *pixels, size_t count, float *rgb, bool *done,
                         struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0, now; i < count && status == KILN_OK; i += now) {
        now = count - i < gloss->part ? count - i : gloss->part;
        status = draw(gloss, pixels + i, now, rgb + 3 * i, done + i, error);
    }
    return status;
}

int kiln_view_gloss_draw_rest(struct kiln_view_gloss *gloss, const size_t *pixels, size_t count, float *rgb,
                              struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0, now; i < count && status == KILN_OK; i += now) {
        now = count - i < gloss->part ? count - i : gloss->part;
        status = draw_rest(gloss, pixels + i, now, rgb + 3 * i, error);
    }
    return status;
}

int kiln_view_gloss_smooth(struct kiln_view_gloss *gloss, float *const planes[3], struct kiln_error *error)
{
    const struct kiln_view_params *p = gloss->params;
    const int status =
        kiln_view_grain_smooth(gloss->grains, gloss->grain_count, p->width, p->height, gloss->each, error);
    for (size_t i = 0; i < gloss->grain_count && status == KILN_OK; i++)
        for (int c = 0; c < 3; c++)
            planes[c][gloss->grains[i].pixel] += gloss->grains[i].light[c];
    return status;
}
