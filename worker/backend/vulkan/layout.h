/* What C and the shaders share, seen from C. */
#ifndef KILN_WORKER_BACKEND_VULKAN_LAYOUT_H
#define KILN_WORKER_BACKEND_VULKAN_LAYOUT_H

#include "worker/base/vector.h"
#include "shaders/shared/layout.h"
#include "shaders/shared/push.h"

#include "worker/backend/backend.h"
#include "worker/pass/point.h"

/* Copied to the device as they are. */
_Static_assert(sizeof(struct kiln_gpu_record) == sizeof(struct kiln_hit_record), "hit records");
_Static_assert(sizeof(struct kiln_gpu_divided) == sizeof(struct kiln_divided_texel), "divided texels");
_Static_assert(sizeof(struct kiln_gpu_lightmap) == sizeof(struct kiln_lightmap), "lightmaps");
_Static_assert(sizeof(struct kiln_gpu_tile) == sizeof(struct kiln_tile) &&
                   sizeof(struct kiln_gpu_tile) == sizeof(struct kiln_split_tile_run),
               "tiles");
_Static_assert(sizeof(struct kiln_gpu_result) == sizeof(struct kiln_point_result), "results");

#endif
