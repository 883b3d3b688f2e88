/* The camera of the bidirectional pass: where in the picture a place is seen, and how dense its rays are there. Ways,
 * random numbers and estimators are those of worker/backend/embree/bidirectional_eye.c and bidirectional_light.c. Needs
 * shaders/bidirectional.glsl before. */
#ifndef KILN_SHADERS_PICTURE_GLSL
#define KILN_SHADERS_PICTURE_GLSL

/* From the lens' middle to a place on it. */
vec3 lens_place(uvec2 numbers)
{
    return kiln_path_lens(BOTH.right, BOTH.up, BOTH.lens_radius, float(real_unit(numbers.x)),
                          float(real_unit(numbers.y)));
}

/* Of the camera's rays, per m2, at a place with this cosine. */
real camera_density(vec3 to_camera, float distance, float cosine)
{
    if (BOTH.orthographic != 0u)
        return real(cosine) / real(BOTH.pixel);
    const real ahead = -real(dot(to_camera, BOTH.forward)), far = real(distance);
    return real(cosine) / (real(BOTH.pixel) * ahead * ahead * ahead * far * far);
}

#endif
