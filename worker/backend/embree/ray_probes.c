#include "worker/backend/embree/ray_probes.h"

void ray_probes_begin(struct ray_probes *p, const struct hemisphere *h, const struct embree_backend *b, size_t tile_run)
{
    const struct kiln_surface *s = b->surface;
    const uint64_t first = kiln_own_of_global(s, s->tile_runs[tile_run].first).at;
    for (uint32_t j = 0; j < h->rays->frame.count; j++)
        p->near_probes[j] = s->near_probes[first + h->rays->frame.place[j]];
}

uint64_t ray_probes_end_rays(struct ray_probes *p, struct hemisphere *h, uint32_t lanes)
{
    struct tile_run_rays *rays = h->rays;
    uint64_t traced = 0;
    for (uint32_t l = 0; l < lanes; l++) {
        const bool sees = (p->near_probes[rays->point[l]] & KILN_PROBE_SEEN) != 0;
        p->sees[l] = sees;
        traced += !sees || p->range > 0.0f;
        if (sees) /* negative length: Embree ignores such a ray */
            rays->packets[l / PACKET].ray.tfar[l % PACKET] = p->range > 0.0f ? p->range : -1.0f;
    }
    return traced;
}

/* The random number that chooses the lane's probe. */
static uint32_t choice_of(const struct tile_run_rays *r, uint32_t step, uint32_t l)
{
    return kiln_probe_choice(kiln_gather_ray_seed(r->chance[l], rays_sample(r, step, l)));
}

/* Classifies the lanes without a hit. A ray that leaves the scene's box within the range has escaped. The others read a
 * probe near their end, stored in `end`. */
static void end_at_range(struct ray_probes *p, struct hemisphere *h, const struct embree_backend *b, uint32_t step)
{
    struct rays_found *found = &h->found;
    const struct tile_run_rays *r = h->rays;
    const struct kiln_probe_grid *grid = &b->probes->grid;
    uint32_t lost = 0;
    p->asking = 0;
    for (uint32_t i = 0; i < found->escaped; i++) {
        const uint32_t l = found->escaped_lane[i];
        const struct kiln_vec3 origin = rays_origin(r, l), direction = rays_direction(r, l);
        p->far[l] = kiln_probe_far(*grid, origin, direction);
        if (!p->sees[l] || p->far[l] <= p->range) {
            found->escaped_lane[lost++] = (uint8_t)l;
            continue;
        }
        const struct kiln_vec3 end = vec3_madd(origin, direction, KILN_PROBE_END * p->range);
        p->end[p->asking] = end;
        p->probe[l] = kiln_probe_draw(grid, kiln_probe_cell(grid, end), kiln_probe_corners(*grid), end,
                                      kiln_unit_float(choice_of(r, step, l)));
        p->asks[p->asking++] = (uint8_t)l;
    }
    found->escaped = lost;
}

/* Traces rays from the ends of lanes [first, first + PACKET) that read probes, to their probes: finds which probes are
 * visible. */
static void look_at_probes(const struct ray_probes *p, const struct embree_backend *b, struct embree_context *context,
                           uint32_t first, bool free[PACKET])
{
    struct RTCRay8 rays = {.mask = {0}};
    int valid[PACKET] __attribute__((aligned(32))) = {0};
    uint32_t seed[PACKET] = {0};
    for (uint32_t i = 0; i < PACKET && first + i < p->asking; i++) {
        const uint32_t probe = p->probe[p->asks[first + i]];
        const struct kiln_vec3 to = vec3_sub(b->probes->positions[probe], p->end[first + i]);
        const float distance = vec3_length(to);
        if (kiln_probe_is_off(b->probes, probe) || !(distance > 0.0f))
            continue;
        const struct kiln_vec3 d = vec3_scale(to, 1.0f / distance);
        valid[i] = -1;
        seed[i] = kiln_ray_seed(p->end[first + i], d);
        rays.org_x[i] = p->end[first + i].x, rays.org_y[i] = p->end[first + i].y, rays.org_z[i] = p->end[first + i].z;
        rays.dir_x[i] = d.x, rays.dir_y[i] = d.y, rays.dir_z[i] = d.z;
        rays.tfar[i] = distance + KILN_PROBE_CLEAR * b->probes->grid.spacing;
        rays.mask[i] = ~0u;
    }
    embree_blocked8(b, context, valid, &rays, seed);
    for (int i = 0; i < PACKET; i++)
        free[i] = valid[i] != 0 && !(rays.tfar[i] < 0.0f);
}

/* Lanes whose probe is not visible from the end of their ray read one that the point sees. */
static void settle_probes(struct ray_probes *p, const struct hemisphere *h, const struct embree_backend *b,
                          struct embree_context *context, uint32_t step)
{
    for (uint32_t first = 0; first < p->asking; first += PACKET) {
        bool free[PACKET] = {false};
        if (p->range > 0.0f)
            look_at_probes(p, b, context, first, free);
        for (uint32_t i = 0; i < PACKET && first + i < p->asking; i++) {
            const uint32_t l = p->asks[first + i], near = p->near_probes[h->rays->point[l]];
            if (!free[i])
                p->probe[l] =
                    kiln_probe_draw(&b->probes->grid, near >> KILN_PROBE_CORNERS, near & KILN_PROBE_SEEN,
                                    rays_origin(h->rays, l), kiln_unit_float(kiln_hash1(choice_of(h->rays, step, l))));
        }
    }
}

void ray_probes_choose(struct ray_probes *p, struct hemisphere *h, const struct embree_backend *b,
                       struct embree_context *context, uint32_t step)
{
    end_at_range(p, h, b, step);
    settle_probes(p, h, b, context, step);
}

void ray_probes_ask(const struct ray_probes *p, const struct hemisphere *h, const struct embree_backend *b, uint32_t l,
                    float rgb[3])
{
    if (hemisphere_weight(h->rays, l) > 0.0f)
        kiln_probe_ask(b->probes, p->probe[l], rays_origin(h->rays, l), rays_direction(h->rays, l), p->far[l], rgb);
    for (int c = 0; c < 3; c++)
        rgb[c] *= (float)KILN_PI; /* as radiosity */
}

void ray_probes_raise_to_zero(struct hemisphere *h)
{
    for (uint32_t j = 0; j < h->rays->frame.count; j++)
        for (int c = 0; c < 3; c++) {
            h->incident[j][c] = h->incident[j][c] < 0.0 ? 0.0 : h->incident[j][c];
            h->irradiance[j][c] = h->irradiance[j][c] < 0.0 ? 0.0 : h->irradiance[j][c];
        }
}
