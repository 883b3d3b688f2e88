#include "coordinator/view/light_level.h"

#include <math.h>

#include "worker/base/color.h"

static double area_of(const struct kiln_geometry *g)
{
    double area = 0.0;
    for (size_t t = 0; t < g->triangle_count; t++)
        area += kiln_geometry_triangle_area(g, t);
    return area;
}

/* Power of lamps, W. */
static double power_of(const struct kiln_lights *l)
{
    double power = 0.0;
    for (size_t i = 0; i < l->area_count; i++)
        power += KILN_PI * l->areas[i].area * (l->areas[i].two_sided ? 2.0 : 1.0) *
                 kiln_luminance_of_floats(l->areas[i].radiance);
    for (size_t i = 0; i < l->point_count; i++)
        power += kiln_punctual_angle(&l->points[i]) * kiln_luminance_of_floats(l->points[i].intensity);
    return power;
}

double kiln_light_level(const struct kiln_lights *lights, const struct kiln_geometry *geometry)
{
    const double area = area_of(geometry),
                 radius = 0.5 * (double)vec3_length(vec3_sub(geometry->bounds_max, geometry->bounds_min)),
                 disk = KILN_PI * radius * radius;
    if (!(area > 0.0))
        return 0.0;
    double level = power_of(lights) / (KILN_PI * area);
    for (size_t i = 0; i < lights->directional_count; i++)
        level += kiln_luminance_of_floats(lights->directionals[i].irradiance) / KILN_PI * fmin(1.0, disk / area);
    if (lights->environment)
        level += kiln_luminance_of_floats(lights->environment_mean) * fmin(1.0, 4.0 * disk / area);
    return level;
}
