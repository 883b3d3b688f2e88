#include "coordinator/view/view_gloss.h"

#include <math.h>

#include "coordinator/view/view_lamps.h"
#include "worker/base/memory.h"
#include "worker/material/surface_bsdf.h"
#include "worker/sampling/keys.h"
#include "worker/scene/footprint.h"
#include "worker/scene/texture.h"

/* Rays that are traced together; surfaces of theirs that lamps light together, which take some 700 bytes each; surfaces
 * that one goes on from at most; and the key of the random numbers. */
enum { BAND_RAYS = 1 << 16, LIT_PLACES = 1 << 13, MOST_SURFACES = 64, KEY = 0x76696577 };

/* Rays that guides learn from, of each pixel for that; how far such pixels are apart at least, along rows and columns;
 * and how many there are at most, about. */
enum { LESSONS = 16, APART_LEAST = 4, LESSON_PIXELS = 1 << 15 };

/* A ray under way, and what it has brought. */
struct walker {
    uint32_t key, number;
    float weight[3], rgb[3];
    bool goes_on, lit; /* `lit`: the last surface has gloss */
    struct kiln_vec3 origin, direction;
    struct kiln_view_way way;
    /* how it left the first surface with rough gloss, by what of the light that reaches the eye; and what it found */
    uint32_t region; /* KILN_NONE: it has met none */
    bool leaves;     /* it has just left that surface */
    struct kiln_vec3 found;
    float weight_there, beyond;
};

struct kiln_view_gloss {
    const struct kiln_view_params *params;
    struct kiln_view_maps *maps;
    struct kiln_view_rays *rays;
    struct walker *walkers;
    uint32_t *active; /* walkers of the rays that are traced */
    struct kiln_gloss_lobes *lobes;
    struct kiln_view_lamps *lamps;
    struct kiln_view_guides *guides;
    struct kiln_view_lit *lit; /* the surfaces with gloss that some of them have met, at most LIT_PLACES at once */
    uint32_t *lit_of;          /* the walkers of these */
    uint32_t side, chains;
    size_t part; /* pixels that there is room for */
};

bool kiln_view_goes_on(const struct kiln_view_source *source, const struct kiln_hit *hit)
{
    return source->field == NULL && !source->texels && kiln_particle_turns(&source->backend->params, hit);
}

/* Ray `number` of a pixel, through place `place` of it; those of another `key` have other chances. */
static void start(const struct kiln_view_gloss *b, uint32_t key, size_t pixel, uint32_t number, uint32_t place,
                  struct walker *w)
{
    const struct kiln_view_params *p = b->params;
    *w = (struct walker){.key = kiln_hash2(kiln_hash2(key, (uint32_t)pixel), (uint32_t)(pixel >> 32)),
                         .number = number,
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
        w->rgb[c] += light;
        w->beyond += w->region != KILN_NONE ? light : 0.0f;
    }
}

/* What a ray has met, where that has gloss: the same for all walkers of the ray. */
struct met {
    struct kiln_hit hit;
    bool gloss; /* else only this and the hit are set */
    struct kiln_particle_place place;
    float radiosity[3], emission[3]; /* W/(m2 sr): what its diffuse part sends, were all taken up; what it emits */
};

/* What the glossy surface sends of its own: from its lightmap, and as a lamp. */
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

/* What the ray of number `ray` has met, in `direction`. */
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

/* What a surface without gloss, or the environment, shows at the end of the ray. */
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

/* What walker w finds at the end of its ray; `lit`: the surface, if it has gloss. */
static void meet(const struct kiln_view_gloss *b, const struct met *met, float passed, struct kiln_vec3 direction,
                 uint32_t surface, struct walker *w, struct kiln_view_lit *lit)
{
    const struct kiln_hit *hit = &met->hit;
    if (w->leaves && hit->triangle != KILN_NONE)
        w->found = kiln_triangle_position(b->params->source.geometry, hit->triangle, hit->u, hit->v);
    else if (w->leaves)
        w->found = vec3_madd(w->origin, direction, kiln_view_guides_far(b->guides));
    w->leaves = false;
    /* nothing but rays comes through what a view does not show */
    const double share = passed > 0.0f ? 1.0 : kiln_view_lamps_share(b->lamps, &w->way, hit, direction);
    w->goes_on = false;
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
    const uint32_t region = kiln_view_guides_region(b->guides, &lit->place, &lit->chance);
    lit->guide = kiln_view_guides_at(b->guides, region, &lit->place);
    const struct kiln_particle_turn turn = kiln_view_guide_turn(&lit->guide, &lit->place, w->weight, &lit->chance);
    add_own(met, &turn, share, w);
    if (w->region == KILN_NONE && !turn.mirrored) {
        w->region = region;
        w->leaves = region != KILN_NONE;
        w->weight_there = w->weight[0] + w->weight[1] + w->weight[2];
    }
    for (int c = 0; c < 3; c++) {
        w->weight[c] *= turn.goes_on[c];
        w->goes_on = w->goes_on || w->weight[c] > 0.0f;
    }
    w->origin = turn.origin;
    w->direction = turn.direction;
    w->way = kiln_view_way(&lit->place, &turn);
}

/* What lamps bring to the surfaces with gloss that active walkers from the `first` on have met, `count` of them. */
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
    for (size_t i = 0; i < lit && status == KILN_OK; i++)
        for (int c = 0; c < 3; c++)
            b->walkers[b->lit_of[i]].rgb[c] += b->lit[i].rgb[c];
    return status;
}

/* What `count` active walkers from the `first` on find at the ends of their rays; at most LIT_PLACES. `alike`: so many
 * walkers that follow each other have one ray. */
static int meet_some(struct kiln_view_gloss *b, size_t first, size_t count, uint32_t alike, uint32_t surface,
                     struct kiln_error *error)
{
#pragma omp parallel for schedule(dynamic, 64)
    for (size_t i = 0; i < count; i += alike) {
        const size_t ray = (first + i) / alike;
        const struct kiln_vec3 direction = b->rays->directions[ray];
        struct met met;
        find_met(b, ray, direction, &met);
        for (size_t k = i; k < i + alike; k++)
            meet(b, &met, b->rays->passed[ray], direction, surface, &b->walkers[b->active[first + k]], &b->lit[k]);
    }
    return add_lamps(b, first, count, error);
}

/* One surface of the first `count` active walkers; how many of them go on. */
static int step(struct kiln_view_gloss *b, size_t *count, uint32_t alike, uint32_t surface, struct kiln_error *error)
{
    struct kiln_view_rays *rays = b->rays;
    const size_t traced = *count / alike;
    for (size_t i = 0; i < traced; i++) {
        rays->origins[i] = b->walkers[b->active[i * alike]].origin;
        rays->directions[i] = b->walkers[b->active[i * alike]].direction;
    }
    int status = kiln_view_trace(&b->params->source, rays, traced, error);
    if (status == KILN_OK)
        status = kiln_view_maps_load(b->maps, rays->hits, traced, error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < *count && status == KILN_OK; i += LIT_PLACES)
        status = meet_some(b, i, *count - i < LIT_PLACES ? *count - i : LIT_PLACES, alike, surface, error);
    size_t left = 0;
    for (size_t i = 0; i < *count; i++)
        if (b->walkers[b->active[i]].goes_on)
            b->active[left++] = b->active[i];
    *count = left;
    return status;
}

/* Follows the first `active` walkers to their ends; so many that follow each other begin `alike`, a part of
 * LIT_PLACES. */
static int follow(struct kiln_view_gloss *b, size_t active, uint32_t alike, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < active; i++)
        b->active[i] = (uint32_t)i;
    for (uint32_t surface = 0; surface < MOST_SURFACES && active > 0 && status == KILN_OK; surface++)
        status = step(b, &active, surface == 0 ? alike : 1, surface, error);
    return status;
}

/* At most as many pixels as there is room for. */
static int draw(struct kiln_view_gloss *b, const size_t *pixels, size_t count, float *rgb, struct kiln_error *error)
{
    const uint32_t rays = b->side * b->side * b->chains;
#pragma omp parallel for schedule(dynamic, 1024)
    for (size_t i = 0; i < count * rays; i++) {
        const uint32_t number = (uint32_t)(i % rays);
        start(b, KEY, pixels[i / rays], number, number / b->chains, &b->walkers[i]);
    }
    const int status = follow(b, count * rays, b->chains, error);
    for (size_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            float sum = 0.0f;
            for (uint32_t k = 0; k < rays; k++)
                sum += b->walkers[i * rays + k].rgb[c];
            rgb[3 * i + (size_t)c] = sum / (float)rays;
        }
    return status;
}

/* ---- guides ---- */

/* The pixels that guides learn from where these see gloss. */
struct grid {
    size_t apart, wide, all; /* pixels; how many in a row of the grid, and in all */
};
static struct grid lesson_grid(const struct kiln_view_params *p)
{
    const double fewest = ceil(sqrt((double)p->width * (double)p->height / LESSON_PIXELS));
    struct grid g = {.apart = fewest > APART_LEAST ? (size_t)fewest : APART_LEAST};
    g.wide = (p->width + g.apart - 1) / g.apart;
    g.all = g.wide * ((p->height + g.apart - 1) / g.apart);
    return g;
}

/* Has guides learn from rays of `count` pixels, at most as many as there is room for. */
static int learn_some(struct kiln_view_gloss *b, const size_t *pixels, size_t count, struct kiln_error *error)
{
    for (size_t i = 0; i < count * LESSONS; i++)
        start(b, ~(uint32_t)KEY, pixels[i / LESSONS], (uint32_t)(i % LESSONS), (uint32_t)i % (b->side * b->side),
              &b->walkers[i]);
    const int status = follow(b, count * LESSONS, 1, error);
    for (size_t i = 0; i < count * LESSONS && status == KILN_OK; i++) {
        const struct walker *w = &b->walkers[i];
        kiln_view_guides_learn(b->guides, w->region, w->found, w->beyond / w->weight_there);
    }
    return status;
}

/* Those of `count` pixels that see gloss, in the midst of a pixel, come first; returns how many. */
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

/* Has guides learn from rays all over the picture. */
static int learn(struct kiln_view_gloss *b, struct kiln_error *error)
{
    const struct grid grid = lesson_grid(b->params);
    const size_t part = b->part * b->side * b->side * b->chains / LESSONS;
    size_t *pixels = NULL;
    int status = kiln_allocate(&pixels, part, sizeof *pixels, "guides of a view", error);
    for (size_t i = 0; i < grid.all && status == KILN_OK; i += part) {
        size_t count = 0;
        for (size_t k = i; k < i + part && k < grid.all; k++)
            pixels[count++] = (k / grid.wide * b->params->width + k % grid.wide) * grid.apart;
        status = keep_gloss(b, pixels, &count, error);
        if (status == KILN_OK)
            status = learn_some(b, pixels, count, error);
    }
    kiln_free(&pixels);
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
    *b = (struct kiln_view_gloss){
        .params = params, .maps = maps, .side = params->side, .chains = params->side < 4 ? 2 : 4};
    const size_t rays = (size_t)b->side * b->side * b->chains;
    b->part = rays < BAND_RAYS ? BAND_RAYS / rays : 1;
    status = kiln_view_rays_create(&b->rays, b->part * rays, error);
    if (status == KILN_OK)
        status = kiln_allocate(&b->walkers, b->part * rays, sizeof *b->walkers, "rays of a view", error);
    if (status == KILN_OK)
        status = kiln_allocate(&b->active, b->part * rays, sizeof *b->active, "rays of a view", error);
    if (status == KILN_OK)
        status = kiln_allocate(&b->lit, LIT_PLACES, sizeof *b->lit, "rays of a view", error);
    if (status == KILN_OK)
        status = kiln_allocate(&b->lit_of, LIT_PLACES, sizeof *b->lit_of, "rays of a view", error);
    if (status == KILN_OK)
        status = kiln_view_lamps_create(&b->lamps, &params->source, LIT_PLACES, error);
    if (status == KILN_OK)
        status = kiln_scene_lobes(&b->lobes, params->source.scene, error);
    if (status == KILN_OK)
        status = kiln_view_guides_create(&b->guides, params->source.geometry, LESSONS * lesson_grid(params).all, error);
    if (status == KILN_OK)
        status = learn(b, error);
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
    kiln_free(&b->walkers);
    kiln_free(&b->active);
    kiln_free(&b->lit);
    kiln_free(&b->lit_of);
    kiln_view_lamps_destroy(&b->lamps);
    kiln_view_guides_destroy(&b->guides);
    kiln_free(&b->lobes);
    kiln_free(gloss);
}

int kiln_view_gloss_draw(struct kiln_view_gloss *gloss, const size_t *pixels, size_t count, float *rgb,
                         struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0, now; i < count && status == KILN_OK; i += now) {
        now = count - i < gloss->part ? count - i : gloss->part;
        status = draw(gloss, pixels + i, now, rgb + 3 * i, error);
    }
    return status;
}
