/* Paths of pixels that move between kernels (path.glsl): loads and stores them. */
#include "shaders/path_states.glsl"

kiln_gpu_path_state state_of(uint surface, vec3 direction, kiln_hit hit)
{
    return kiln_gpu_path_state(direction, hit.triangle | (hit.back ? KILN_GPU_BOTH_BACK : 0u), hit.u, hit.v,
                               hit.distance, float[3](weight.r, weight.g, weight.b), float[3](seen.r, seen.g, seen.b),
                               float[3](radiance.r, radiance.g, radiance.b), surface, bounces, chain, rays,
                               good ? 1u : 0u);
}

void load(kiln_gpu_path_state s, out uint surface, out vec3 direction, out kiln_hit hit)
{
    surface = s.surface;
    direction = s.direction;
    hit.triangle = s.triangle & ~KILN_GPU_BOTH_BACK;
    hit.back = (s.triangle & KILN_GPU_BOTH_BACK) != 0u;
    hit.u = s.u;
    hit.v = s.v;
    hit.distance = s.distance;
    weight = vec3(s.weight[0], s.weight[1], s.weight[2]);
    seen = vec3(s.seen[0], s.seen[1], s.seen[2]);
    radiance = vec3(s.radiance[0], s.radiance[1], s.radiance[2]);
    bounces = s.bounces;
    chain = s.chain;
    rays = s.rays;
    good = s.good != 0u;
}

/* Whether this kernel follows paths from such a surface. */
bool is_own(kiln_hit hit)
{
    const bool gloss = (material_of(hit.triangle) & KILN_RECORD_GLOSS) != 0u;
    return TURN.onward == 0ul || gloss == MEETS_GLOSS;
}

void follow(uint slot)
{
    const uint64_t pixel = push.index + slot % push.count;
    uint surface = 0u;
    vec3 direction;
    kiln_hit hit;
    bool under_way = true;
    walk_key = pixel_key(pixel);
    walk_sample = push.first_sample + slot / push.count;
    rays = 0u;
    good = true;
    if (TURN.list == 0ul)
        under_way = init_from_camera(pixel, direction, hit);
    else
        load(PATH_STATE(slot), surface, direction, hit);
    bool own = under_way && is_own(hit);
    for (; own; surface++) {
        under_way = shade_surface(surface, direction, hit);
        own = under_way && is_own(hit);
    }
    good = good && !own;
    PATH_STATE(slot) = state_of(surface, direction, hit);
    if (under_way) {
        const uint place = atomicAdd(TurnWords(TURN.go_onward).at[0], 1u);
        TurnWords(TURN.onward).at[place] = slot;
    }
}

void kiln_kernel(uint x, uint y)
{
    const uint count = TURN.list == 0ul ? push.count * push.samples : TurnWords(TURN.counter).at[0];
    if (x >= count || y > 0u)
        return;
    const uint slot = TURN.list == 0ul ? x : TurnWords(TURN.list).at[x];
    follow(slot);
    if (!still_loops(push.count))
        PATH_STATE(slot).good = 0u;
}
