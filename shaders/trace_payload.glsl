/* What the shaders of the ray-tracing pipeline hand each other, 16 bytes. */
#define KILN_PAYLOAD_BACK 0x80000000u /* with the triangle's number; KILN_GPU_NONE alone: nothing was met */

struct kiln_payload {
    uint triangle_back;
    float u, v, distance;
};
