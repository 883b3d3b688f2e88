/* The camera of the bidirectional pass, with the functions that shaders/shared/bidirectional.h and path.h need. Needs
 * shaders/bidirectional.glsl before. */
#ifndef KILN_SHADERS_PICTURE_GLSL
#define KILN_SHADERS_PICTURE_GLSL

/* Offset of a random position on the lens from its centre. */
vec3 lens_place(uvec2 numbers)
{
    return kiln_path_lens(BOTH.right, BOTH.up, BOTH.lens_radius, float(real_unit(numbers.x)),
                          float(real_unit(numbers.y)));
}

/* Returns the density of camera rays, per m2, at a surface whose normal has this cosine to the ray. */
real camera_density(vec3 to_camera, float distance, float cosine)
{
    return kiln_camera_density(BOTH.orthographic != 0u, to_camera, BOTH.forward, real(distance), real(cosine),
                               real(BOTH.pixel));
}

#endif
