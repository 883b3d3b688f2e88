/* Segmentation: divides a mesh into connected segments whose normals lie in a narrow cone. */
#ifndef KILN_COORDINATOR_LAYOUT_SEGMENT_H
#define KILN_COORDINATOR_LAYOUT_SEGMENT_H

#include "coordinator/layout/topology.h"

/* Half the opening angle of the cone that holds a chart's normals. Projected along the cone's axis, nothing folds over,
 * and no length shrinks below the angle's cosine, 0.77. */
#define KILN_CHART_CONE (40.0 * KILN_PI / 180.0)

struct kiln_segments {
    size_t count;
    uint32_t *segment;       /* per triangle: its segment, or KILN_NONE if degenerate */
    struct kiln_dvec3 *axes; /* per segment: unit axis of a cone that holds its normals */
};

/* Finds flat patches by flood fill, then merges patches in order of cost, as in hierarchical face clustering (Garland,
 * Willmott, Heckbert, "Hierarchical Face Clustering on Polygonal Surfaces", 2001). The cost grows with the opening
 * angle of the merged cone and falls with the fraction of the smaller patch's border that disappears. O(n log n).
 * Segments are numbered by their first triangle. Destroy with kiln_segments_destroy. */
int kiln_segments_create(struct kiln_segments **segments, const struct kiln_topology *topology,
                         struct kiln_error *error);
void kiln_segments_destroy(struct kiln_segments **segments);

#endif
