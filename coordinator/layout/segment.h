/* Cuts a mesh into connected pieces whose normals lie in a narrow cone. */
#ifndef KILN_COORDINATOR_LAYOUT_SEGMENT_H
#define KILN_COORDINATOR_LAYOUT_SEGMENT_H

#include "coordinator/layout/topology.h"

/* Half the opening of the cone that holds a chart's normals. Seen along the cone's axis nothing folds over and no
 * length shrinks below its cosine: 0.77. */
#define KILN_CHART_CONE (40.0 * KILN_PI / 180.0)

struct kiln_segments {
    size_t count;
    uint32_t *segment;       /* a triangle: its segment, or KILN_NONE where degenerate */
    struct kiln_dvec3 *axes; /* a segment: unit axis of a cone that holds its normals */
};

/* Flat patches first (flood fill), then patches are merged in order of cost as in hierarchical face clustering
 * (Garland, Willmott, Heckbert, "Hierarchical Face Clustering on Polygonal Surfaces", 2001): the cost grows with the
 * opening of the merged cone and falls with the share of the smaller one's border that disappears. O(n log n). Segments
 * are numbered by their first triangle. Destroy with kiln_segments_destroy. */
int kiln_segments_create(struct kiln_segments **segments, const struct kiln_topology *topology,
                         struct kiln_error *error);
void kiln_segments_destroy(struct kiln_segments **segments);

#endif
