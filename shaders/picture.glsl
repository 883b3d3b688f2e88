/* The camera of the bidirectional pass, as shaders/shared/bidirectional.h and path.h have it. Needs
 * shaders/bidirectional.glsl before. */
#ifndef KILN_SHADERS_PICTURE_GLSL
#define KILN_SHADERS_PICTURE_GLSL

/* From the lens' middle to a place on it. */
vec3 lens_place(uvec2 numbers)
{
    return kiln_path_lens(BOTH.right, BOTH.up, BOTH.lens_radius, float(real_unit(numbers.x)),
                          float(real_unit(numbers.y)));
}

/* Returns the density of the camera's rays, per m2, at a place with this cosine. */
real camera_density(vec3 to_camera, float distance, float cosine)
{
    return kiln_camera_density(BOTH.orthographic != 0u, to_camera, BOTH.forward, real(distance), real(cosine),
                               real(BOTH.pixel));
}

#endif
