/* What a ray of a view meets: hits through the backs of single-sided surfaces, and the light of the published lightmaps
 * there. Private to coordinator/view/view*.c. Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_LIGHT_H
#define KILN_COORDINATOR_VIEW_VIEW_LIGHT_H

#include "coordinator/view/view.h"

/* A batch of rays. The caller fills origins and directions (unit); kiln_view_trace fills the rest and moves the origins
 * of rays that went on behind a back. */
struct kiln_view_rays {
    size_t capacity;
    struct kiln_vec3 *origins, *directions;
    struct kiln_hit *hits; /* distance is from the last origin: passed + distance is from the first */
    float *passed;         /* m from the first origin to the last; above 0: the ray went through a back */
    uint32_t *active;      /* rays still under way, and what is traced of them */
    struct kiln_vec3 *active_origins, *active_directions;
    struct kiln_hit *active_hits;
};

int kiln_view_rays_create(struct kiln_view_rays **rays, size_t capacity, struct kiln_error *error);
void kiln_view_rays_destroy(struct kiln_view_rays **rays);

/* Traces rays 0..count-1; those that meet a single-sided surface from behind go on behind it. */
int kiln_view_trace(const struct kiln_view_source *source, struct kiln_view_rays *rays, size_t count,
                    struct kiln_error *error);

/* Whether the ray's hit is a surface that shows this side: not nothing, not the back of a single-sided one, and nothing
 * of a caster-only object, which has no lightmap, unless it emits. */
bool kiln_view_is_seen(const struct kiln_view_source *source, const struct kiln_hit *hit);

/* The lightmaps of a bake, each read when it is first needed. */
struct kiln_view_maps;

/* `coarse` > 0: each lightmap is averaged down to at most so many texels a side, which bounds the memory. */
int kiln_view_maps_create(struct kiln_view_maps **maps, const struct kiln_view_source *source, uint32_t coarse,
                          struct kiln_error *error);
void kiln_view_maps_destroy(struct kiln_view_maps **maps);

/* Reads the lightmaps that hits 0..count-1 lie on: the object's, and for hits from behind its lightmaps/back where that
 * was baked
 * (--sides two). KILN_NO_INPUT, KILN_BAD_INPUT. */
int kiln_view_maps_load(struct kiln_view_maps *maps, const struct kiln_hit *hits, size_t count,
                        struct kiln_error *error);

/* Irradiance at a hit that is seen and whose lightmap is loaded, bilinear, as a sampler that clamps at the edge; 0
 * where there is none, on a caster-only object. Thread-safe. */
void kiln_view_irradiance(const struct kiln_view_maps *maps, const struct kiln_hit *hit, float rgb[3]);

/* Whether a hit is from behind and the back's light was not baked as a lightmap: the front's stands in for it. */
bool kiln_view_lends(const struct kiln_view_maps *maps, const struct kiln_hit *hit);

/* What is seen along a ray. */
struct kiln_view_seen {
    float rgb[3]; /* base colour x E / pi + emission, or the environment; with source->texels the checkerboard */
    float metal;  /* how much of the surface is a metal, 0..1, whose reflection this stands in for */
    float lent;   /* 1: a back that shows its front's light */
};

/* Thread-safe. */
void kiln_view_radiance(const struct kiln_view_maps *maps, const struct kiln_hit *hit, struct kiln_vec3 direction,
                        struct kiln_view_seen *seen);

#endif
