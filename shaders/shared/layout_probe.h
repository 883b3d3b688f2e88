/* The probe pass: data that C and GLSL share. */

/* samples a slice, over the sphere or of lights; short, as some devices stop long loops */
#define KILN_GPU_PROBE_SAMPLES 16u

/* Stages of probes.comp: bits of its own constant. Rays over the sphere and light samples are apart, for drivers take
 * long to compile the two together. */
#define KILN_GPU_PROBE_GROUPED 1u /* the result of each ray is kept for groups of lights */
#define KILN_GPU_PROBE_RAYS 2u
#define KILN_GPU_PROBE_LIGHTS 4u /* after the rays: adds to their sums */

/* Floats of a slice, and of a probe's answer: the members of struct kiln_probe_result in order, then the number of
 * shadow rays. A mean distance below 0 marks a wrong answer: the device ended a loop early. */
#define KILN_GPU_PROBE_FLOATS 48u
/* Floats of a light group at a probe: the light members of its answer. The first below 0: the device ended a loop
 * early. */
#define KILN_GPU_PROBE_GROUP_FLOATS 45u
/* Bytes that are kept of a ray over the sphere, and of a light sample: shaders/probe_found.glsl. */
#define KILN_GPU_PROBE_FOUND_BYTES 16u
#define KILN_GPU_PROBE_LIGHT_BYTES 28u
