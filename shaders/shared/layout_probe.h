/* The probes' pass: what C and GLSL share of it. */

/* samples a slice: of the sphere, and of the lights; some devices do not stand long loops */
#define KILN_GPU_PROBE_SAMPLES 16u

/* Floats a slice of a probe, and a probe's answer: those of struct kiln_probe_result in order, and last the shadow
 * rays. A mean distance below 0: the device ended a loop early, the answer is not good. */
#define KILN_GPU_PROBE_FLOATS 48u
/* Floats of a group of lights at a probe: those that are light. The first below 0: likewise. */
#define KILN_GPU_PROBE_GROUP_FLOATS 45u
/* Bytes that are kept of a ray over the sphere, and of a light sample: shaders/probe_found.glsl. */
#define KILN_GPU_PROBE_FOUND_BYTES 16u
#define KILN_GPU_PROBE_LIGHT_BYTES 28u
