/* Data layouts that C and the shaders share, seen from C. */
#ifndef KILN_WORKER_BACKEND_VULKAN_LAYOUT_H
#define KILN_WORKER_BACKEND_VULKAN_LAYOUT_H

#include "worker/base/vector.h"
#include "shaders/shared/bsdf_lobes.h"
#include "shaders/shared/layout.h"
#include "shaders/shared/push.h"

#include "worker/backend/backend.h"
#include "worker/pass/point.h"

/* Structs that are copied to the device unchanged. */
_Static_assert(sizeof(struct kiln_gpu_record) == sizeof(struct kiln_hit_record), "hit records");
_Static_assert(sizeof(struct kiln_bsdf_lobes) == 524, "lobes of materials");
_Static_assert(sizeof(struct kiln_gpu_result) == sizeof(struct kiln_point_result), "results");

#endif
