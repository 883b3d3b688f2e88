/* What tracing needs on the device; part of shaders/layout.h. */

struct kiln_gpu_trace {
    KILN_ADDRESS nodes, triangles; /* a BVH for compute, see shaders/bvh.glsl */
    KILN_ADDRESS top_level;        /* acceleration structure of the ray-tracing pipeline */
    KILN_WORD node_count, triangle_count;
};
KILN_SIZE_IS(kiln_gpu_trace, 32);
