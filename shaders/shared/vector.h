/* Vectors of three components in C: float for tracing (relative to the centre of the scene), double for areas, totals
 * and world positions. GLSL has its own, vec3 and dvec3. */
#ifndef KILN_SHADERS_SHARED_VECTOR_H
#define KILN_SHADERS_SHARED_VECTOR_H

#include <math.h>

struct kiln_vec2 {
    float x, y;
};
struct kiln_vec3 {
    float x, y, z;
};
struct kiln_dvec3 {
    double x, y, z;
};

#define KILN_PI 3.14159265358979323846

static inline struct kiln_vec3 vec3(float x, float y, float z) { return (struct kiln_vec3){x, y, z}; }
static inline struct kiln_vec3 vec3_add(struct kiln_vec3 a, struct kiln_vec3 b)
{
    return vec3(a.x + b.x, a.y + b.y, a.z + b.z);
}
static inline struct kiln_vec3 vec3_sub(struct kiln_vec3 a, struct kiln_vec3 b)
{
    return vec3(a.x - b.x, a.y - b.y, a.z - b.z);
}
static inline struct kiln_vec3 vec3_mul(struct kiln_vec3 a, struct kiln_vec3 b)
{
    return vec3(a.x * b.x, a.y * b.y, a.z * b.z);
}
static inline struct kiln_vec3 vec3_scale(struct kiln_vec3 a, float s) { return vec3(a.x * s, a.y * s, a.z * s); }
static inline struct kiln_vec3 vec3_madd(struct kiln_vec3 a, struct kiln_vec3 b, float s)
{
    return vec3(a.x + b.x * s, a.y + b.y * s, a.z + b.z * s);
}
static inline float vec3_dot(struct kiln_vec3 a, struct kiln_vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline struct kiln_vec3 vec3_cross(struct kiln_vec3 a, struct kiln_vec3 b)
{
    return vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static inline float vec3_length(struct kiln_vec3 a) { return sqrtf(vec3_dot(a, a)); }
/* Unit vector along a; the zero vector stays zero. */
static inline struct kiln_vec3 vec3_normalize(struct kiln_vec3 a)
{
    const float length = vec3_length(a);
    return length > 0.0f ? vec3_scale(a, 1.0f / length) : a;
}

static inline struct kiln_dvec3 dvec3(double x, double y, double z) { return (struct kiln_dvec3){x, y, z}; }
static inline struct kiln_dvec3 dvec3_of(struct kiln_vec3 a) { return dvec3((double)a.x, (double)a.y, (double)a.z); }
static inline struct kiln_vec3 vec3_of(struct kiln_dvec3 a) { return vec3((float)a.x, (float)a.y, (float)a.z); }
static inline struct kiln_dvec3 dvec3_add(struct kiln_dvec3 a, struct kiln_dvec3 b)
{
    return dvec3(a.x + b.x, a.y + b.y, a.z + b.z);
}
static inline struct kiln_dvec3 dvec3_sub(struct kiln_dvec3 a, struct kiln_dvec3 b)
{
    return dvec3(a.x - b.x, a.y - b.y, a.z - b.z);
}
static inline struct kiln_dvec3 dvec3_scale(struct kiln_dvec3 a, double s) { return dvec3(a.x * s, a.y * s, a.z * s); }
static inline double dvec3_dot(struct kiln_dvec3 a, struct kiln_dvec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline struct kiln_dvec3 dvec3_cross(struct kiln_dvec3 a, struct kiln_dvec3 b)
{
    return dvec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static inline double dvec3_length(struct kiln_dvec3 a) { return sqrt(dvec3_dot(a, a)); }

#endif
