/* Connects light vertices to the camera: thread x makes the shadow ray from vertex `offset` + x. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"

KILN_PUSH(kiln_gpu_both_push);

layout(constant_id = 6) const uint METHOD = 15u; /* KILN_GPU_BOTH_...: what the method does */
const bool CONNECTS = (METHOD & KILN_GPU_BOTH_CONNECTS) != 0u, POINTS = false;

#define KILN_LIFTS
#include "shaders/bidirectional.glsl"
#include "shaders/picture.glsl"
#include "shaders/subpaths.glsl"

struct View { /* struct subpath_view */
    uint64_t pixel;
    vec3 origin, towards;
    float distance;
};

/* Projects a point to the picture, as seen from `eye`: x and y are -1 to 1. */
bool picture_place(vec3 eye, vec3 place, out real x, out real y)
{
    const real3 right = real3(BOTH.right), up = real3(BOTH.up);
    real3 to = real3(place - eye);
    const real depth = dot(to, real3(BOTH.forward));
    real over = BOTH.orthographic != 0u ? real(1) : depth;
    if (BOTH.lens_radius > 0.0) { /* by the intersection of the ray with the focal plane, seen from the lens' centre */
        over = real(BOTH.focus_distance);
        to = to * (over / depth) + real3(eye - BOTH.position);
    }
    x = dot(to, right) / (dot(right, right) * over);
    y = dot(to, up) / (dot(up, up) * over);
    return depth > 0;
}

/* `numbers`: random numbers for the position on the lens. */
bool view_of(vec3 place, uvec2 numbers, out View view)
{
    real x, y;
    view.origin = BOTH.position;
    if (BOTH.lens_radius > 0.0)
        view.origin += lens_place(numbers);
    if (!picture_place(view.origin, place, x, y))
        return false;
    const real column = floor(KILN_RATIO(1, 2) * (x + 1) * real(BOTH.width)),
               row = floor(KILN_RATIO(1, 2) * (1 - y) * real(BOTH.height));
    if (!(column >= 0) || !(row >= 0) || !(column < real(BOTH.width)) || !(row < real(BOTH.height)))
        return false;
    view.pixel = uint64_t(uint(row)) * BOTH.width + uint(column);
    if (BOTH.orthographic != 0u)
        view.origin += BOTH.right * float(x) + BOTH.up * float(y);
    const vec3 back = view.origin - place;
    view.distance = length(back);
    view.towards = back / view.distance;
    return view.distance > 0.0;
}

/* Whether the side of the surface with the vertex faces the camera. */
bool faces(kiln_gpu_light_vertex kept, vec3 front, vec3 towards)
{
    kiln_hit hit = hit_of(kept.triangle, kept.u, kept.v, 0.0);
    hit.back = dot(front, towards) < 0.0;
    return (triangle_at(hit.triangle).flags & KILN_GPU_PATH_HIDDEN) == 0u && has_side(hit);
}

void connect(kiln_gpu_light_vertex kept, View view)
{
    Vertex v = vertex_of(kept, true);
    Scatter s;
    if (v.m.gloss)
        vertex_lift(0.0, v); /* the camera's rays end at the surface */
    if (!faces(kept, v.front, view.towards) || !vertex_scatter(v, view.towards, v.from, KILN_LOBE_ALL, s) ||
        !(s.landing_o > 0.0))
        return;
    const vec3 product = scatter_product(s, kept.number > 0u, vec3(1.0), vec3(0.0), int(BOTH.most) - int(v.bounces));
    const real density = camera_density(view.towards, view.distance, s.cosine_o) / real(BOTH.paths);
    const real share = CONNECTS ? kiln_path_weight_seen(path_techniques(), v.sums, density, real(s.to_light)) : real(1);
    const vec3 d = vertex_start(v, view.towards) - view.origin;
    const float distance = length(d);
    if (shines(product))
        ask_shadow(view.origin, d / distance, float(real(distance) * KILN_SHADOW_LENGTH),
                   product * v.weight * vertex_attenuation(v, view.towards, view.distance) * float(density * share),
                   uint(view.pixel), ~path_chance(push.light_key, kept.path, kept.number));
}

void kiln_kernel(uint x, uint y)
{
    if (y > 0u || !has_work(x))
        return;
    const kiln_gpu_light_vertex kept = LIGHT_VERTEX(push.offset + x);
    if (uint64_t(kept.path) - push.pixel >= push.pixels) /* also those before it */
        return;
    walk_key = push.light_key;
    walk_sample = kept.path;
    View view;
    if (view_of(kept.position, walk_draw(kiln_path_use(kept.number, KILN_LENS_USE)), view))
        connect(kept, view);
}

#include "shaders/main.glsl"
