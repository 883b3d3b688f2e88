#include "worker/backend/embree/bidirectional_vertex.h"

#include <math.h>

#include "shaders/shared/color.h"
#include "worker/scene/footprint.h"
#include "worker/scene/texture.h"

/* ---- vertices ---- */

static uint32_t find_mirrors(const struct kiln_bsdf_lobes *l)
{
    const bool base = l->base_is_mirror && l->p.model == KILN_BSDF_LAYERS;
    return (base ? KILN_LOBE_GLOSS : 0u) | (l->coat_is_mirror ? KILN_LOBE_COAT : 0u);
}

static void find_material(const struct embree_backend *b, struct vertex *v)
{
    const struct kiln_scene *scene = b->params.scene;
    const struct meeting *m = &v->m;
    if (m->gloss == NULL) {
        float rgba[4];
        (v->is_first ? kiln_surface_base_color : kiln_surface_color)(scene, m->mesh, m->stored, m->b1, m->b2, rgba);
        for (int c = 0; c < 3; c++)
            v->color[c] = rgba[c];
        return;
    }
    const struct kiln_bsdf_choice *c = &m->shares;
    v->mirrors = find_mirrors(&m->lobes);
    v->is_delta = c->diffuse == 0.0f && c->near == 0.0f && c->far == 0.0f &&
                  (c->gloss == 0.0f || (v->mirrors & KILN_LOBE_GLOSS) != 0) &&
                  (c->coat == 0.0f || (v->mirrors & KILN_LOBE_COAT) != 0);
}

/* All but its opacity. */
static struct vertex make(const struct embree_backend *b, const struct meeting *m, struct kiln_vec3 direction,
                          bool is_first)
{
    struct vertex v = {.m = *m, .from = vec3_scale(direction, -1.0f), .opacity = 1.0f, .is_first = is_first};
    v.front = v.smooth = m->back ? vec3_scale(m->normal, -1.0f) : m->normal;
    if (m->gloss != NULL && (m->mesh->flags & KILN_MESH_SMOOTH) != 0)
        v.smooth = kiln_triangle_shading_normal(b->params.scene, b->params.geometry, m->triangle, m->u, m->v);
    if (!(vec3_dot(v.smooth, v.front) > 0.0f))
        v.smooth = v.front;
    find_material(b, &v);
    return v;
}

bool vertex_is_smooth(const struct vertex *v)
{
    const struct kiln_bsdf_choice c = kiln_bsdf_choice_of(v->m.shares, v->m.others);
    return c.near == 0.0f && c.far == 0.0f && (c.gloss == 0.0f || (v->mirrors & KILN_LOBE_GLOSS) != 0) &&
           (c.coat == 0.0f || (v->mirrors & KILN_LOBE_COAT) != 0);
}

struct vertex vertex_of(const struct embree_backend *b, const struct meeting *m, struct kiln_vec3 direction)
{
    return make(b, m, direction, false);
}

struct vertex vertex_make(const struct embree_backend *b, const struct RTCRayHit *ray, bool is_first)
{
    const struct kiln_vec3 direction = vec3(ray->ray.dir_x, ray->ray.dir_y, ray->ray.dir_z);
    struct meeting m = meeting_make(b, ray);
    meeting_face(b, is_first, direction, &m);
    meeting_lift(b, is_first || m.gloss != NULL, &m);
    struct vertex v = make(b, &m, direction, is_first);
    if (m.triangle >= b->params.geometry->opaque_count)
        v.opacity = kiln_surface_opacity(b->params.scene, m.mesh, m.stored, m.b1, m.b2);
    return v;
}

struct vertex vertex_as_first(const struct embree_backend *b, const struct vertex *v)
{
    struct vertex first = *v;
    first.is_first = true;
    if (v->m.gloss != NULL)
        return first;
    first.m.normal = first.m.shading = v->front;
    meeting_face(b, true, vec3_scale(v->from, -1.0f), &first.m);
    find_material(b, &first);
    return first;
}

/* ---- scattering ---- */

/* The scattering frame of a path that arrives from w. */
static struct kiln_frame frame_of(const struct embree_backend *b, const struct vertex *v, struct kiln_vec3 w)
{
    const bool smooth = vec3_dot(v->smooth, w) > 0.0f,
               agrees = v->m.lifted ? smooth != v->m.back : smooth == (vec3_dot(v->front, w) > 0.0f);
    const struct kiln_vec3 z = agrees ? v->smooth : v->front, now = v->m.frame.z;
    return z.x == now.x && z.y == now.y && z.z == now.z ? v->m.frame : meeting_frame(b, &v->m, z);
}

/* The axis half-way between both normals, about which directions of camera paths are drawn. */
static struct kiln_vec3 axis_of(const struct vertex *v)
{
    return v->is_first ? vec3_normalize(vec3_add(v->m.normal, v->m.shading)) : v->m.normal;
}

static bool scatter_diffuse(const struct vertex *v, struct kiln_vec3 o, struct kiln_vec3 i, struct vertex_scatter *s)
{
    const double no = (double)vec3_dot(v->m.normal, o), ni = (double)vec3_dot(v->m.normal, i);
    if (!(no > 0.0) || !(v->m.lifted ? s->cosine_i > 0.0 : ni > 0.0))
        return false;
    const double share = v->is_first ? fmax(0.0, (double)vec3_dot(v->m.shading, i)) / s->cosine_i : 1.0;
    s->to_light = fmax(0.0, (double)vec3_dot(axis_of(v), i)) / KILN_PI;
    s->to_eye = no / KILN_PI;
    for (int c = 0; c < 3; c++)
        s->all[c] = s->diffuse[c] = share * (double)v->color[c] / KILN_PI;
    return s->all[0] > 0.0 || s->all[1] > 0.0 || s->all[2] > 0.0;
}

static struct kiln_bsdf_choice choice_of(const struct vertex *v, struct kiln_vec3 w, struct kiln_vec3 local,
                                         uint32_t lobes)
{
    const bool same = w.x == v->from.x && w.y == v->from.y && w.z == v->from.z;
    return kiln_bsdf_choice_of(same ? v->m.shares : kiln_bsdf_shares(v->m.lobes, local), lobes);
}

/* Whether w is on the same side of the geometric normal and of the frame; where rays are lifted, whether it is above
 * the frame. */
static bool agrees(const struct vertex *v, struct kiln_vec3 w, struct kiln_vec3 local)
{
    if (v->m.lifted)
        return v->m.back ? local.z < 0.0f : local.z > 0.0f;
    return (local.z > 0.0f) == (vec3_dot(v->front, w) > 0.0f) && local.z != 0.0f;
}

static void set_value(double to[3], struct kiln_vec3 value, double cosine)
{
    to[0] = (double)value.x / cosine;
    to[1] = (double)value.y / cosine;
    to[2] = (double)value.z / cosine;
}

static bool scatter_whole(const struct embree_backend *b, const struct vertex *v, struct kiln_vec3 o,
                          struct kiln_vec3 i, uint32_t lobes, struct vertex_scatter *s)
{
    const struct kiln_frame eye = frame_of(b, v, o), light = frame_of(b, v, i);
    const struct kiln_vec3 eye_o = kiln_into_frame(&eye, o), eye_i = kiln_into_frame(&eye, i),
                           light_o = kiln_into_frame(&light, o), light_i = kiln_into_frame(&light, i);
    if (!agrees(v, i, eye_i) || !(s->cosine_i > 0.0))
        return false;
    const struct kiln_bsdf_choice choice = choice_of(v, o, eye_o, lobes);
    const struct kiln_bsdf_value all =
        kiln_bsdf_evaluate_chosen(v->m.lobes, choice, eye_o, eye_i, KILN_RADIANCE, lobes);
    set_value(s->all, all.value, s->cosine_i);
    s->to_light = (double)all.density;
    if (!(s->all[0] > 0.0 || s->all[1] > 0.0 || s->all[2] > 0.0))
        return false;
    if (v->m.lobes.matt > 0.0f && (lobes & KILN_LOBE_DIFFUSE) != 0)
        set_value(s->diffuse,
                  kiln_bsdf_evaluate_chosen(v->m.lobes, choice, eye_o, eye_i, KILN_RADIANCE, KILN_LOBE_DIFFUSE).value,
                  s->cosine_i);
    if (agrees(v, o, light_o))
        s->to_eye = (double)kiln_bsdf_evaluate_chosen(v->m.lobes, choice_of(v, i, light_i, lobes), light_i, light_o,
                                                      KILN_RADIANCE, lobes)
                        .density;
    return true;
}

/* See struct vertex_scatter. */
static double landing(const struct vertex *v, struct kiln_vec3 w)
{
    const double cosine = (double)vec3_dot(v->m.normal, w);
    return v->m.lifted ? fmax(0.0, cosine) : fabs(cosine);
}

bool vertex_scatter(const struct embree_backend *b, const struct vertex *v, struct kiln_vec3 o, struct kiln_vec3 i,
                    uint32_t lobes, struct vertex_scatter *s)
{
    *s = (struct vertex_scatter){.cosine_o = fabs((double)vec3_dot(v->m.normal, o)),
                                 .cosine_i = fabs((double)vec3_dot(v->m.normal, i)),
                                 .landing_o = landing(v, o),
                                 .landing_i = landing(v, i)};
    return v->m.gloss == NULL ? scatter_diffuse(v, o, i, s) : scatter_whole(b, v, o, i, lobes, s);
}

/* ---- the way on ---- */

/* Density of the reverse direction relative to the forward one, at refraction, which maps directions one to one: n^2
 * |cos| dw is equal on both sides (Veach 1997, equation 5.4). */
static double squeeze(const struct kiln_bsdf_lobes *l, struct kiln_vec3 o, struct kiln_vec3 i)
{
    if ((o.z > 0.0f) == (i.z > 0.0f) || l->p.thin_wall != 0u)
        return 1.0;
    const double eta = (double)kiln_bsdf_eta(l->p, o.z > 0.0f).y;
    return fabs((double)o.z / (double)i.z) / (eta * eta);
}

/* Completes a direction drawn at a mirror or smooth glass, where densities are probabilities. */
static bool leave_mirror(const struct embree_backend *b, const struct vertex *v, bool of_light, uint32_t lobes,
                         const struct kiln_bsdf_drawn *d, struct vertex_way *way)
{
    const struct kiln_frame other = frame_of(b, v, way->direction);
    const bool same = vec3_dot(other.z, v->m.frame.z) == vec3_dot(v->m.frame.z, v->m.frame.z);
    float adjoint = 1.0f;
    if (of_light) {
        if (!same)
            return false;
        adjoint = kiln_shading_correction(v->m.o, d->i, kiln_into_frame(&v->m.frame, v->front));
    }
    way->delta = true;
    way->forward = (double)d->density;
    if (same)
        way->backward = (double)kiln_bsdf_reverse(v->m.lobes, v->m.o, *d, lobes) * squeeze(&v->m.lobes, v->m.o, d->i);
    way->factor[0] = d->weight.x * adjoint;
    way->factor[1] = d->weight.y * adjoint;
    way->factor[2] = d->weight.z * adjoint;
    return way->forward > 0.0;
}

/* Decides at random whether the event counts as diffuse, by the luminance of the diffuse share. */
static void label(const struct vertex *v, const struct vertex_scatter *s, double rest, struct vertex_way *way)
{
    const double part = kiln_luminance(s->diffuse), chance = part / kiln_luminance(s->all);
    way->diffuse = v->m.gloss == NULL || rest < chance;
    if (v->m.gloss == NULL || !(part > 0.0) || !(chance < 1.0))
        return;
    for (int c = 0; c < 3; c++) {
        const double share = s->all[c] > 0.0 ? fmin(1.0, s->diffuse[c] / s->all[c]) : 0.0;
        way->factor[c] *= (float)(way->diffuse ? share / chance : (1.0 - share) / (1.0 - chance));
    }
}

static bool leave_surface(const struct embree_backend *b, const struct vertex *v, bool of_light, uint32_t lobes,
                          double rest, struct vertex_way *way)
{
    struct vertex_scatter s;
    if (!vertex_scatter(b, v, of_light ? way->direction : v->from, of_light ? v->from : way->direction, lobes, &s))
        return false;
    way->forward = of_light ? s.to_eye : s.to_light;
    way->backward = of_light ? s.to_light : s.to_eye;
    if (!(way->forward > 0.0))
        return false;
    for (int c = 0; c < 3; c++)
        way->factor[c] = (float)(s.all[c] * way->cosine / way->forward);
    label(v, &s, rest, way);
    return true;
}

bool vertex_leave(const struct embree_backend *b, const struct vertex *v, bool of_light, uint32_t lobes,
                  const double numbers[4], struct vertex_way *way)
{
    const float pick = (float)numbers[0], u = (float)numbers[2], w = (float)numbers[3];
    *way = (struct vertex_way){.delta = false};
    struct kiln_bsdf_drawn d = {.delta = false};
    if (v->m.gloss == NULL) {
        const struct kiln_frame frame = kiln_frame_about(axis_of(v));
        way->direction = vec3_normalize(kiln_out_of_frame(&frame, kiln_bsdf_cosine(u, w)));
    } else {
        d = kiln_bsdf_propose(v->m.lobes, kiln_bsdf_choice_of(v->m.shares, lobes), v->m.o, pick, u, w,
                              of_light ? KILN_IMPORTANCE : KILN_RADIANCE);
        way->direction = vec3_normalize(kiln_out_of_frame(&v->m.frame, d.i));
        if (!agrees(v, way->direction, d.i))
            return false;
    }
    way->cosine = fabs((double)vec3_dot(v->m.normal, way->direction));
    way->landing = landing(v, way->direction);
    if (!(way->cosine > 0.0))
        return false;
    return d.delta ? leave_mirror(b, v, of_light, lobes, &d, way)
                   : leave_surface(b, v, of_light, lobes, numbers[1], way);
}

void vertex_attenuate(const struct vertex *v, struct kiln_vec3 direction, float distance, float light[3])
{
    float share[3];
    if (v->m.gloss == NULL || (v->m.gloss->flags & KILN_GLOSS_VOLUME) == 0 || vec3_dot(v->front, direction) > 0.0f)
        return;
    kiln_gloss_attenuation(v->m.gloss, distance, share);
    for (int c = 0; c < 3; c++)
        light[c] *= share[c];
}
