/* Reads the leaves of an octree (worker/scene/leaves.h) from kiln.h5, as an image of one row with a pixel a leaf. Not
 * collective. */
#ifndef KILN_COORDINATOR_OUTPUT_READ_LEAVES_H
#define KILN_COORDINATOR_OUTPUT_READ_LEAVES_H

#include "coordinator/output/image.h"

/* Channels of the image: components 0, 1 and 2 of the dataset that is asked for (of fewer components the last again);
 * what /points/facing, leaf, object and side say; and 1 where the point is valid. In byte order. */
#define KILN_LEAF_CHANNELS                                                                                             \
    {                                                                                                                  \
        "B", "G", "R", "facing", "leaf.x", "leaf.y", "leaf.z", "object", "side", "valid"                               \
    }
enum { KILN_LEAF_CHANNEL_COUNT = 10 };

/* Reads an open file, whose descriptor is borrowed. `dataset` has floats of every point, such as "/irradiance/total".
 * KILN_NO_INPUT if the file has no such dataset; KILN_BAD_INPUT if it is none of an octree or is damaged. For the
 * confined child of a reader (reader.h). */
int kiln_leaves_read(int descriptor, const char *path, const char *dataset, struct kiln_image **image,
                     struct kiln_error *error);

#endif
