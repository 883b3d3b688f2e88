/* Materials of the tests of scattering functions, and what a white furnace may find of each. */
#ifndef KILN_TESTS_UNIT_BSDF_MATERIALS_H
#define KILN_TESTS_UNIT_BSDF_MATERIALS_H

#include <stdbool.h>

#include "shaders/shared/bsdf.h"

struct material {
    const char *name;
    float metallic, transmission, index, coat, coat_alpha, anisotropy;
    bool thin_wall, behind; /* behind: light comes from behind the face */
    bool draws;             /* draws are held against densities, too */
    bool textured;          /* prepared as at a hit, for its roughness has a texture; */
    bool coat_varies;       /* the coat's has one, too */
    float darkest, brightest;
};

enum { METAL, MATT, GLASS };
static const struct material materials[] = {
    {"metal", .metallic = 1, .index = 1.5f, .draws = true, .darkest = 0.99f, .brightest = 1.001f},
    {"matt", .index = 1.5f, .draws = true, .darkest = 0.99f, .brightest = 1.001f},
    {"glass", .transmission = 1, .index = 1.5f, .draws = true, .darkest = 0.99f, .brightest = 1.001f},
    {"glass from behind", .transmission = 1, .index = 1.5f, .behind = true, .draws = true, .darkest = 0.99f,
     .brightest = 1.001f},
    {"water", .transmission = 1, .index = 1.33f, .darkest = 0.99f, .brightest = 1.001f},
    {"water from behind", .transmission = 1, .index = 1.33f, .behind = true, .darkest = 0.99f, .brightest = 1.001f},
    {"diamond from behind", .transmission = 1, .index = 2.42f, .behind = true, .darkest = 0.99f, .brightest = 1.001f},
    {"thin wall", .transmission = 1, .index = 1.5f, .thin_wall = true, .draws = true, .darkest = 0.99f,
     .brightest = 1.001f},
    {"dense matt", .index = 2.5f, .darkest = 0.99f, .brightest = 1.001f},
    {"coated matt", .index = 1.5f, .coat = 1, .coat_alpha = 0.1f, .draws = true, .darkest = 0.99f, .brightest = 1.001f},
    {"coated metal", .metallic = 1, .index = 1.5f, .coat = 1, .coat_alpha = 0.0f, .darkest = 0.99f,
     .brightest = 1.001f},
    {"coated glass", .transmission = 1, .index = 1.5f, .coat = 1, .darkest = 0.99f, .brightest = 1.001f},
    {"coated glass from behind", .transmission = 1, .index = 1.5f, .coat = 1, .behind = true, .draws = true,
     .darkest = 0.99f, .brightest = 1.001f},
    {"rough coat over glass from behind", .transmission = 1, .index = 1.5f, .coat = 1, .coat_alpha = 0.3f,
     .behind = true, .darkest = 0.99f, .brightest = 1.001f},
    /* peaks near the critical angle are wider than what 9 cosines tell of them */
    {"coated water from behind", .transmission = 1, .index = 1.33f, .coat = 1, .behind = true, .darkest = 0.99f,
     .brightest = 1.004f},
    {"coated thin wall from behind", .transmission = 1, .index = 1.5f, .coat = 1, .thin_wall = true, .behind = true,
     .darkest = 0.99f, .brightest = 1.001f},
    {"mixture", .metallic = 0.3f, .transmission = 0.5f, .index = 1.5f, .coat = 0.5f, .coat_alpha = 0.3f, .draws = true,
     .darkest = 0.99f, .brightest = 1.001f},
    {"brushed metal", .metallic = 1, .index = 1.5f, .anisotropy = 0.4f, .draws = true, .darkest = 0.99f,
     .brightest = 1.001f},
    {"brushed thin wall", .transmission = 1, .index = 1.5f, .thin_wall = true, .anisotropy = 0.4f, .darkest = 0.99f,
     .brightest = 1.001f},
    {"much brushed metal", .metallic = 1, .index = 1.5f, .anisotropy = 0.8f, .darkest = 0.99f, .brightest = 1.001f},
    {"brushed matt", .index = 1.5f, .anisotropy = 0.4f, .draws = true, .darkest = 0.99f, .brightest = 1.001f},
    {"much brushed matt", .index = 1.5f, .anisotropy = 0.8f, .darkest = 0.99f, .brightest = 1.001f},
    {"coated brushed matt", .index = 1.5f, .coat = 1, .coat_alpha = 0.1f, .anisotropy = 0.4f, .darkest = 0.99f,
     .brightest = 1.001f},
    {"brushed glass", .transmission = 1, .index = 1.5f, .anisotropy = 0.4f, .draws = true, .darkest = 0.99f,
     .brightest = 1.001f},
    {"brushed glass from behind", .transmission = 1, .index = 1.5f, .anisotropy = 0.4f, .behind = true, .draws = true,
     .darkest = 0.99f, .brightest = 1.001f},
    {"much brushed glass", .transmission = 1, .index = 1.5f, .anisotropy = 0.8f, .darkest = 0.99f, .brightest = 1.001f},
    {"much brushed glass from behind", .transmission = 1, .index = 1.5f, .anisotropy = 0.8f, .behind = true,
     .darkest = 0.99f, .brightest = 1.001f},
    {"brushed water from behind", .transmission = 1, .index = 1.33f, .anisotropy = 0.4f, .behind = true,
     .darkest = 0.99f, .brightest = 1.002f},
    {"brushed diamond from behind", .transmission = 1, .index = 2.42f, .anisotropy = 0.4f, .behind = true,
     .darkest = 0.99f, .brightest = 1.001f},
    {"coated brushed glass from behind", .transmission = 1, .index = 1.5f, .coat = 1, .anisotropy = 0.4f,
     .behind = true, .darkest = 0.988f, .brightest = 1.002f},
    {"coated brushed metal", .metallic = 1, .index = 1.5f, .coat = 1, .anisotropy = 0.4f, .darkest = 0.99f,
     .brightest = 1.001f},
    {"rough coat over much brushed metal", .metallic = 1, .index = 1.5f, .coat = 1, .coat_alpha = 0.3f,
     .anisotropy = 0.8f, .darkest = 0.99f, .brightest = 1.001f},
    {"coated brushed glass", .transmission = 1, .index = 1.5f, .coat = 1, .anisotropy = 0.4f, .darkest = 0.99f,
     .brightest = 1.001f},
    {"coated brushed thin wall", .transmission = 1, .index = 1.5f, .coat = 1, .thin_wall = true, .anisotropy = 0.4f,
     .darkest = 0.99f, .brightest = 1.001f},
    {"brushed mixture", .metallic = 0.3f, .transmission = 0.5f, .index = 1.5f, .coat = 0.5f, .coat_alpha = 0.3f,
     .anisotropy = 0.4f, .draws = true, .darkest = 0.99f, .brightest = 1.001f},
    {"textured coated glass from behind", .transmission = 1, .index = 1.5f, .coat = 1, .behind = true, .textured = true,
     .draws = true, .darkest = 0.99f, .brightest = 1.001f},
    {"textured rough coat over glass from behind", .transmission = 1, .index = 1.5f, .coat = 0.7f, .coat_alpha = 0.3f,
     .behind = true, .textured = true, .coat_varies = true, .darkest = 0.99f, .brightest = 1.001f},
    {"textured coated water from behind", .transmission = 1, .index = 1.33f, .coat = 1, .behind = true,
     .textured = true, .darkest = 0.99f, .brightest = 1.004f},
    {"textured coated glass", .transmission = 1, .index = 1.5f, .coat = 1, .textured = true, .darkest = 0.99f,
     .brightest = 1.001f},
    {"textured brushed metal", .metallic = 1, .index = 1.5f, .anisotropy = 0.4f, .textured = true, .darkest = 0.99f,
     .brightest = 1.001f},
    {"textured brushed matt", .index = 1.5f, .anisotropy = 0.4f, .textured = true, .draws = true, .darkest = 0.99f,
     .brightest = 1.001f},
    {"textured much brushed matt", .index = 1.5f, .anisotropy = 0.8f, .textured = true, .darkest = 0.99f,
     .brightest = 1.001f},
    {"textured brushed glass", .transmission = 1, .index = 1.5f, .anisotropy = 0.4f, .textured = true, .darkest = 0.99f,
     .brightest = 1.001f},
    {"textured brushed glass from behind", .transmission = 1, .index = 1.5f, .anisotropy = 0.4f, .behind = true,
     .textured = true, .draws = true, .darkest = 0.99f, .brightest = 1.001f},
    {"textured much brushed glass from behind", .transmission = 1, .index = 1.5f, .anisotropy = 0.8f, .behind = true,
     .textured = true, .darkest = 0.99f, .brightest = 1.001f},
    {"textured brushed water from behind", .transmission = 1, .index = 1.33f, .anisotropy = 0.4f, .behind = true,
     .textured = true, .darkest = 0.99f, .brightest = 1.002f},
    {"textured coated brushed metal", .metallic = 1, .index = 1.5f, .coat = 1, .anisotropy = 0.4f, .textured = true,
     .darkest = 0.99f, .brightest = 1.001f},
    {"textured coated brushed matt", .index = 1.5f, .coat = 1, .coat_alpha = 0.1f, .anisotropy = 0.4f, .textured = true,
     .darkest = 0.99f, .brightest = 1.001f},
    {"textured coated brushed glass from behind", .transmission = 1, .index = 1.5f, .coat = 1, .anisotropy = 0.4f,
     .behind = true, .textured = true, .darkest = 0.988f, .brightest = 1.002f},
    {"textured brushed mixture", .metallic = 0.3f, .transmission = 0.5f, .index = 1.5f, .coat = 0.5f,
     .coat_alpha = 0.3f, .anisotropy = 0.4f, .textured = true, .darkest = 0.99f, .brightest = 1.001f},
};
#define MATERIALS (sizeof materials / sizeof *materials)

static inline struct kiln_bsdf white_material(const struct material *m, float alpha)
{
    struct kiln_bsdf p = {.base_color = {1, 1, 1},
                          .specular_color = {1, 1, 1},
                          .eta = {m->index, m->index, m->index},
                          .metallic = m->metallic,
                          .transmission = m->transmission,
                          .specular = 1.0f,
                          .coat = m->coat,
                          .coat_alpha = m->coat_alpha,
                          .thin_wall = m->thin_wall,
                          .model = KILN_BSDF_LAYERS};
    kiln_bsdf_alphas(sqrtf(alpha), m->anisotropy, &p.alpha_x, &p.alpha_y);
    return p;
}

/* The same with colours, and with dispersion. */
static inline struct kiln_bsdf colored_material(const struct material *m, float alpha)
{
    struct kiln_bsdf p = white_material(m, alpha);
    p.base_color = vec3(0.9f, 0.5f, 0.2f);
    p.specular_color = vec3(1.0f, 0.8f, 0.6f);
    p.specular = 0.9f;
    p.eta = kiln_dispersed_index(m->index, 1.0f);
    return p;
}

#endif
