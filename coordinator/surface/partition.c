#include "coordinator/surface/build.h"

void kiln_partition_cut(const uint64_t *unit_points, size_t unit_count, uint32_t ranks, uint64_t *bounds)
{
    uint64_t total = 0;
    for (size_t i = 0; i < unit_count; i++)
        total += unit_points[i];
    size_t unit = 0;
    uint64_t before = 0; /* points of the units before `unit` */
    bounds[0] = 0;
    for (uint32_t r = 1; r < ranks; r++) {
        const uint64_t ideal = kiln_partition_ideal(total, ranks, r);
        for (; unit < unit_count && before < ideal; unit++) {
            const uint64_t after = before + unit_points[unit];
            if (after > ideal && after - ideal >= ideal - before)
                break; /* the border before this unit is nearer, or as near */
            before = after;
        }
        bounds[r] = unit;
    }
    bounds[ranks] = unit_count;
}
