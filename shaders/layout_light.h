/* Lights on the device; part of shaders/layout.h. */

struct kiln_gpu_lights {
    KILN_ADDRESS nodes, areas, points, directionals;
};
KILN_SIZE_IS(kiln_gpu_lights, 32);
