/* Real spherical harmonics, bands 0..2, orthonormal, in the order 00, 1-1, 10, 11, 2-2, 2-1, 20, 21, 22 (Ramamoorthi
 * and Hanrahan, "An Efficient Representation for Irradiance Environment Maps", 2001). C evaluates them in double, GLSL
 * in float.
 *
 * KILN_HARMONICS_EACH(F, d) calls F(index, value) for the nine basis functions at the unit direction d;
 * KILN_HARMONICS_LINEAR(F, d) for the first four, those of bands 0 and 1. */
#ifndef KILN_SHADERS_SHARED_HARMONICS_H
#define KILN_SHADERS_SHARED_HARMONICS_H

#define KILN_HARMONICS 9

#define KILN_HARMONICS_LINEAR(F, d)                                                                                    \
    F(0, 0.28209479177387814)                                                                                          \
    F(1, 0.4886025119029199 * (d).y)                                                                                   \
    F(2, 0.4886025119029199 * (d).z)                                                                                   \
    F(3, 0.4886025119029199 * (d).x)

#define KILN_HARMONICS_EACH(F, d)                                                                                      \
    KILN_HARMONICS_LINEAR(F, d)                                                                                        \
    F(4, 1.0925484305920792 * (d).x * (d).y)                                                                           \
    F(5, 1.0925484305920792 * (d).y * (d).z)                                                                           \
    F(6, 0.31539156525252005 * (3.0 * (d).z * (d).z - 1.0))                                                            \
    F(7, 1.0925484305920792 * (d).x * (d).z)                                                                           \
    F(8, 0.5462742152960396 * ((d).x * (d).x - (d).y * (d).y))

#endif
