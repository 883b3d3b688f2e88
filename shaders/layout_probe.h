/* The probes' pass: what C and GLSL share of it. */

#define KILN_GPU_PROBE_SAMPLES 64u /* samples a slice: of the sphere, and of the lights */

/* Floats a slice of a probe, and a probe's answer: those of struct kiln_probe_result in order, and last the shadow rays. */
#define KILN_GPU_PROBE_FLOATS 48u
