/* Shading of view rays: reads the light at their hits from the published lightmaps. Private to coordinator/view.
 * Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_LIGHT_H
#define KILN_COORDINATOR_VIEW_VIEW_LIGHT_H

#include "coordinator/view/point_map.h"
#include "coordinator/view/view_rays.h"

/* Reads the lightmaps of the objects at hits 0..count-1; for hits on backs, the lightmap in lightmaps/back if it was
 * baked (--sides two). KILN_NO_INPUT, KILN_BAD_INPUT. */
int kiln_view_maps_load(struct kiln_view_maps *maps, const struct kiln_hit *hits, size_t count,
                        struct kiln_error *error);

/* Irradiance about the shading normal (or the source's field) at a visible hit whose lightmap is loaded, filtered
 * bilinearly and clamped at the edge; 0 on a caster-only object, which has no lightmap. Thread-safe. */
void kiln_view_irradiance(const struct kiln_view_maps *maps, const struct kiln_hit *hit, float rgb[3]);

/* Functions for the atlas. The first reads the lightmap of an object's front. The second gives its light or field at a
 * position in texels from the upper left corner; NaN if there is no value. The third gives the colour of the
 * checkerboard there, viewed perpendicularly. */
int kiln_view_maps_load_object(struct kiln_view_maps *maps, uint32_t object, struct kiln_error *error);
void kiln_view_map_at(const struct kiln_view_maps *maps, uint32_t object, const float at[2], float rgb[3]);
void kiln_view_texel_color(uint32_t object, const float at[2], float rgb[3]);

/* Sets the values of the source's field at all points, instead of reading them from kiln.h5. Takes ownership: *rows
 * becomes NULL. To be called before a lightmap is loaded. */
void kiln_view_maps_take_rows(struct kiln_view_maps *maps, struct kiln_point_dataset **rows);

/* Tells whether the hit is on a back that has no lightmap and is shown with the light of its front. */
bool kiln_view_shows_front(const struct kiln_view_maps *maps, const struct kiln_hit *hit);

/* The radiance along a ray, and how much of it is approximate. */
struct kiln_view_seen {
    /* base colour x E / pi + emission, with E about the mapped normal, or the environment; with source->texels the
     * checkerboard; with source->field its values, and where there is none 0, or NaN if colours have a range */
    float rgb[3];
    float metal;       /* metalness of the surface, 0 to 1, which is shown as diffuse */
    float front_light; /* 1: a back that is shown with the light of its front; else 0 */
    float flat;        /* 1: a material with a normal map, without it: the lightmap lacks directions; else 0 */
    float mapped;      /* 1: a material with a normal map, with it; else 0 */
    /* E, if the ray shows base colour x E / pi + emission of an opaque hit; else -1 */
    float irradiance[3];
};

/* Computes what is seen along the ray with this hit and direction. Thread-safe. */
void kiln_view_radiance(const struct kiln_view_maps *maps, const struct kiln_hit *hit, struct kiln_vec3 direction,
                        struct kiln_view_seen *seen);

/* Radiance seen at a hit where E is known: base colour x E / pi + emission. Thread-safe. */
void kiln_view_lit(const struct kiln_view_maps *maps, const struct kiln_hit *hit, const float irradiance[3],
                   float rgb[3]);

/* Emission of the surface at a hit, W/(m2 sr). Thread-safe. */
void kiln_view_emission(const struct kiln_view_maps *maps, const struct kiln_hit *hit, float rgb[3]);

#endif
