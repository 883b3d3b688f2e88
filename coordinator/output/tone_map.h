/* Tone mapping from linear radiance to sRGB: exposure and tone curves. Nothing here is collective. */
#ifndef KILN_COORDINATOR_OUTPUT_TONE_MAP_H
#define KILN_COORDINATOR_OUTPUT_TONE_MAP_H

#include "coordinator/output/image.h"

/* Tone curves, in the order of --tone-map. Each takes radiance times exposure, c = (r, g, b), linear Rec. 709 with 0.18
 * for middle grey. Each is monotonic on greys and shows black as black.
 *
 * FILMIC is in the manner of AgX (Sobotka: AgX, github.com/sobotka/AgX, 2022), with numbers of its own. Colours are
 * drawn towards grey, c' = 0.85 c + 0.15 mean(c), so that bright saturated light turns to white as on film, and not to
 * a primary colour. Each component is encoded as stops from middle grey, x = log2(c' / 0.18), between -10 and m, and
 * goes through a sigmoid to the sRGB code y. With y0 the code of middle grey, and k the slope of sRGB's code there
 * (0.149 for each stop), y(x) = y0 + s h(k x / s), h(t) = t / (1 + |t|^p)^(1/p). p is 1.5 below middle grey and 2
 * above; s is chosen for each side so that y(-10) = 0 and y(m) = 1. The first step is then inverted on y as linear
 * light: (c - 0.15 mean(c)) / 0.85. So middle grey stays 0.18 with its contrast, and colours of middle lightness do not
 * change. White is m stops above middle grey, at the white point w, with m clamped to 4 to 6.5.
 *
 * REINHARD is Reinhard, Stark, Shirley, Ferwerda: Photographic Tone Reproduction for Digital Images (2002), equation 4,
 * on luminance L: c (1 + L / w^2) / (1 + L), with the white point w. It keeps the hue.
 *
 * ACES is Stephen Hill's fit to the reference rendering transform and the output transform for sRGB (ACES.hlsl of
 * BakingLab, github.com/TheRealMJP/BakingLab, 2016): c' = A c, y = (c' (c' + 0.0245786) - 0.000090537) / (c' (0.983729
 * c' + 0.432951) + 0.238081), then B y, with his matrices A and B. c is multiplied by 1.46 before, which makes middle
 * grey 0.18; else it would be 0.11, darker than with the other curves.
 *
 * NONE shows c itself, and everything above 1 as 1. */
enum kiln_tone_curve { KILN_TONE_FILMIC = 0, KILN_TONE_REINHARD = 1, KILN_TONE_ACES = 2, KILN_TONE_NONE = 3 };

/* The name of a curve, as for --tone-map. */
const char *kiln_tone_name(enum kiln_tone_curve curve);

/* Exposure: radiance is multiplied by `scale`; scaled luminance of `white` and more is shown white. */
struct kiln_exposure {
    double scale, white;
};

/* Without automatic exposure: scale 1, and white 4.5 stops above middle grey. */
extern const struct kiln_exposure kiln_plain_exposure;

/* Automatic exposure: the scale that brings the logarithmic mean of luminance to 0.18 (Reinhard et al. 2002), and as
 * white the 99th percentile of scaled luminance, at least 0.5. Uses pixels with finite luminance above 0. The mean
 * leaves out the darkest and the brightest 5 % of them, so that neither a lamp nor a black corner determines it.
 * Without such pixels the scale is 1 and white infinite. Deterministic.
 *
 * `level`: the luminance that the lights would give if they lit all surfaces alike (view/light_level.h); 0: unknown. An
 * image more than KILN_EXPOSURE_STOPS darker than `level` is not brought to middle grey: a light leak, or a black room
 * with a few bright places, stays dark. */
#define KILN_EXPOSURE_STOPS 10.0
struct kiln_exposure kiln_auto_exposure(const struct kiln_image *image, double level);

struct kiln_tone {
    enum kiln_tone_curve curve;
    double exposure; /* factor on radiance */
    double white;    /* white point of REINHARD and FILMIC; infinity: none */
};

/* Computes the sRGB codes, 0 to 1, of linear RGB. The result is magenta if a component is not finite, so that errors
 * are visible. */
void kiln_tone_map_color(const struct kiln_tone *tone, const float rgb[3], double code[3]);

/* Tone-maps an image to 8-bit sRGB, rounded, 3 x width x height bytes at `bytes`. KILN_BAD_INPUT if the image has no
 * R, G, B. */
int kiln_tone_map(const struct kiln_image *image, const struct kiln_tone *tone, uint8_t *bytes,
                  struct kiln_error *error);

/* Tone-maps the image and publishes it as a PNG file at the destination (publish.h). `description` is as for
 * kiln_png_write_bytes. */
int kiln_png_write(const char *directory, const char *name, const struct kiln_image *image,
                   const struct kiln_tone *tone, const char *description, struct kiln_error *error);

#endif
