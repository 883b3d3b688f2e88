#include "coordinator/output/tone_map.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "worker/base/memory.h"

const struct kiln_exposure kiln_plain_exposure = {1.0, 4.0};

const char *kiln_tone_name(enum kiln_tone_curve curve)
{
    static const char *const names[] = {"filmic", "reinhard", "aces", "none"};
    return names[curve];
}

/* ---- exposure ---- */

/* Histogram of luminances, with bins of 1/16 stop over the range of a float. */
enum { STOP_LEAST = -150, STOP_PARTS = 16, STOP_BINS = (128 - STOP_LEAST) * STOP_PARTS };

static int bin_of(double luminance)
{
    const int bin = (int)floor((log2(luminance) - STOP_LEAST) * STOP_PARTS);
    return bin < 0 ? 0 : bin >= STOP_BINS ? STOP_BINS - 1 : bin;
}

static int bin_at(const uint64_t bins[STOP_BINS], double below)
{
    uint64_t sum = 0;
    int bin = 0;
    for (; bin < STOP_BINS - 1; bin++) {
        sum += bins[bin];
        if ((double)sum > below)
            break;
    }
    return bin;
}

struct kiln_exposure kiln_auto_exposure(const struct kiln_image *image, double level)
{
    uint64_t bins[STOP_BINS] = {0}, used = 0, kept = 0;
    double sum = 0.0;
    float *rgb[3];
    const size_t count = (size_t)image->width * image->height;
    if (!kiln_image_rgb(image, "", rgb))
        return (struct kiln_exposure){1.0, INFINITY};
    for (int pass = 0; pass < 2; pass++) {
        const int low = pass == 0 ? 0 : bin_at(bins, 0.05 * (double)used),
                  high = pass == 0 ? STOP_BINS : bin_at(bins, 0.95 * (double)used);
        for (size_t i = 0; i < count; i++) {
            const float luminance = kiln_rgb_luminance(rgb[0][i], rgb[1][i], rgb[2][i]);
            if (!isfinite(luminance) || !(luminance > 0.0f))
                continue;
            const int bin = bin_of((double)luminance);
            if (pass == 0) {
                bins[bin]++;
                used++;
            } else if (bin >= low && bin <= high) {
                sum += log((double)luminance);
                kept++;
            }
        }
    }
    if (kept == 0)
        return (struct kiln_exposure){1.0, INFINITY};
    const double most = level > 0.0 ? 0.18 / level * exp2(KILN_EXPOSURE_STOPS) : INFINITY,
                 scale = fmin(0.18 / exp(sum / (double)kept), most),
                 bright = exp2((double)(bin_at(bins, 0.99 * (double)used) + 1) / STOP_PARTS + STOP_LEAST);
    return (struct kiln_exposure){scale, fmax(0.5, scale * bright)};
}

/* ---- curves ---- */

static const double GREY = 0.18;

static double mean(const double v[3]) { return (v[0] + v[1] + v[2]) / 3.0; }

static double srgb_code(double linear)
{
    const double clamped = linear > 0.0 ? fmin(linear, 1.0) : 0.0;
    return clamped <= 0.0031308 ? 12.92 * clamped : 1.055 * pow(clamped, 1.0 / 2.4) - 0.055;
}

static double srgb_linear(double code) { return code <= 0.04045 ? code / 12.92 : pow((code + 0.055) / 1.055, 2.4); }

static void reinhard(const struct kiln_tone *tone, const float rgb[3], double out[3])
{
    const double luminance = tone->exposure * (double)kiln_rgb_luminance(rgb[0], rgb[1], rgb[2]);
    const double scale = luminance > 0.0
                             ? tone->exposure * (1.0 + luminance / (tone->white * tone->white)) / (1.0 + luminance)
                             : tone->exposure;
    for (int c = 0; c < 3; c++)
        out[c] = scale * (double)rgb[c];
}

static void multiply(const double matrix[3][3], const double v[3], double out[3])
{
    for (int r = 0; r < 3; r++)
        out[r] = matrix[r][0] * v[0] + matrix[r][1] * v[1] + matrix[r][2] * v[2];
}

static void aces(const double rgb[3], double out[3])
{
    static const double into[3][3] = {{0.59719, 0.35458, 0.04823},
                                      {0.07600, 0.90834, 0.01566},
                                      {0.02840, 0.13383, 0.83777}},
                        back[3][3] = {{1.60475, -0.53108, -0.07367},
                                      {-0.10208, 1.10813, -0.00605},
                                      {-0.00327, -0.07276, 1.07602}};
    /* the fit is 0.18 at 0.26314668: the positive root of 0.82292878 x^2 - 0.05335258 x - 0.042945117 */
    static const double to_grey = 0.26314668216861 / 0.18;
    double scaled[3], working[3];
    for (int c = 0; c < 3; c++)
        scaled[c] = to_grey * rgb[c];
    multiply(into, scaled, working);
    for (int c = 0; c < 3; c++) {
        const double x = fmax(working[c], 0.0);
        working[c] = (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.432951) + 0.238081);
    }
    multiply(back, working, out);
}

static const double FILMIC_LEAST = 10.0, FILMIC_WHITE[2] = {4.0, 6.5}, /* stops below and above middle grey */
    FILMIC_TOE = 1.5, FILMIC_SHOULDER = 2.0, FILMIC_INSET = 0.15;

/* One branch of the sigmoid: starts with `slope`, bends with `power`, and reaches its end value exactly after `wide`
 * stops. */
struct branch {
    double slope, power, wide, scale;
};

static struct branch make_branch(double slope, double power, double wide, double high)
{
    const double run = slope * wide;
    return (struct branch){slope, power, wide, run / pow(pow(run / high, power) - 1.0, 1.0 / power)};
}

static double branch_at(const struct branch *b, double stops)
{
    const double t = b->slope * fmin(stops, b->wide) / b->scale;
    return b->scale * t / pow(1.0 + pow(t, b->power), 1.0 / b->power);
}

/* Filmic curve: sRGB codes as a function of stops from middle grey. */
struct filmic {
    double grey;
    struct branch toe, shoulder;
};

static struct filmic make_filmic(double white)
{
    const double grey = srgb_code(GREY), slope = M_LN2 / 2.4 * (grey + 0.055), /* of the sRGB code at middle grey */
        most = fmin(fmax(log2(white / GREY), FILMIC_WHITE[0]), FILMIC_WHITE[1]);
    return (struct filmic){.grey = grey,
                           .toe = make_branch(slope, FILMIC_TOE, FILMIC_LEAST, grey),
                           .shoulder = make_branch(slope, FILMIC_SHOULDER, most, 1.0 - grey)};
}

static double sigmoid(const struct filmic *f, double stops)
{
    return stops < 0.0 ? f->grey - branch_at(&f->toe, -stops) : f->grey + branch_at(&f->shoulder, stops);
}

static void filmic(const struct filmic *f, const double rgb[3], double out[3])
{
    const double grey = mean(rgb);
    for (int c = 0; c < 3; c++) {
        const double drawn = (1.0 - FILMIC_INSET) * rgb[c] + FILMIC_INSET * grey;
        out[c] = drawn > 0.0 ? srgb_linear(sigmoid(f, log2(drawn / GREY))) : 0.0;
    }
    const double after = mean(out);
    for (int c = 0; c < 3; c++)
        out[c] = (out[c] - FILMIC_INSET * after) / (1.0 - FILMIC_INSET);
}

/* Maps a linear colour to three sRGB codes, 0 to 1: by the exposure, then by the curve of the tone. A colour that is
 * not finite becomes magenta. `f`: curve of a filmic tone; other tones do not read it. */
static void map_color(const struct kiln_tone *tone, const struct filmic *f, const float rgb[3], double code[3])
{
    double exposed[3], shown[3];
    if (!isfinite(rgb[0]) || !isfinite(rgb[1]) || !isfinite(rgb[2])) {
        code[0] = code[2] = 1.0;
        code[1] = 0.0;
        return;
    }
    for (int c = 0; c < 3; c++)
        exposed[c] = shown[c] = tone->exposure * (double)rgb[c];
    if (tone->curve == KILN_TONE_FILMIC)
        filmic(f, exposed, shown);
    else if (tone->curve == KILN_TONE_REINHARD)
        reinhard(tone, rgb, shown);
    else if (tone->curve == KILN_TONE_ACES)
        aces(exposed, shown);
    for (int c = 0; c < 3; c++)
        code[c] = srgb_code(shown[c]);
}

/* ---- many colours ---- */

/* Tables of a function of positive numbers: linear between 2^PARTS places per octave, which suffices for most bytes.
 * Closer than NEAR to the border between two bytes the function itself is evaluated. */
enum { PARTS = 8, OCTAVE_LEAST = -14, OCTAVES = 22, ENTRIES = (OCTAVES << PARTS) + 1 };
static const float NEAR = 0.004f;

struct tables {
    float curve[ENTRIES]; /* filmic: from exposed to shown */
    float code[ENTRIES];  /* 255 x sRGB code of the tone-mapped value */
};

static double place_at(size_t i)
{
    const size_t part = i & ((1u << PARTS) - 1);
    return ldexp(1.0 + (double)part / (1 << PARTS), OCTAVE_LEAST + (int)(i >> PARTS));
}

static void make_tables(struct tables *t, const struct filmic *f)
{
    for (size_t i = 0; i < ENTRIES; i++) {
        const double place = place_at(i);
        t->curve[i] = (float)srgb_linear(sigmoid(f, log2(place / GREY)));
        t->code[i] = (float)(255.0 * srgb_code(place));
    }
}

/* False: beyond the table. */
static bool look_up(const float table[ENTRIES], float x, float *value)
{
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    const int32_t i = (int32_t)(bits >> (23 - PARTS)) - ((127 + OCTAVE_LEAST) << PARTS);
    if (i < 0 || i >= ENTRIES - 1) /* negative numbers, infinities and NaN too */
        return false;
    const float part = (float)(bits & ((1u << (23 - PARTS)) - 1)) * (1.0f / (float)(1u << (23 - PARTS)));
    *value = table[i] + part * (table[i + 1] - table[i]);
    return true;
}

/* Maps a filmic colour to bytes by the tables. False: too close to a border between bytes. */
static bool map_by_tables(const struct tables *t, double exposure, const float rgb[3], uint8_t bytes[3])
{
    const float inset = (float)FILMIC_INSET, scale = (float)exposure;
    float shown[3];
    const float grey = scale * (rgb[0] + rgb[1] + rgb[2]) * (1.0f / 3.0f);
    for (int c = 0; c < 3; c++)
        if (!look_up(t->curve, (1.0f - inset) * scale * rgb[c] + inset * grey, &shown[c]))
            return false;
    const float after = (shown[0] + shown[1] + shown[2]) * (1.0f / 3.0f);
    for (int c = 0; c < 3; c++) {
        float code;
        if (!look_up(t->code, (shown[c] - inset * after) * (1.0f / (1.0f - inset)), &code) || !(code < 255.0f - NEAR))
            return false;
        const int whole = (int)(code + 0.5f);
        const float beyond = code + 0.5f - (float)whole;
        if (beyond < NEAR || beyond > 1.0f - NEAR)
            return false;
        bytes[c] = (uint8_t)whole;
    }
    return true;
}

void kiln_tone_map_color(const struct kiln_tone *tone, const float rgb[3], double code[3])
{
    const struct filmic f = make_filmic(tone->white);
    map_color(tone, &f, rgb, code);
}

int kiln_tone_map(const struct kiln_image *image, const struct kiln_tone *tone, uint8_t *bytes,
                  struct kiln_error *error)
{
    float *planes[3];
    if (!kiln_image_rgb(image, "", planes))
        return kiln_fail(error, KILN_BAD_INPUT, "the image has no channels R, G and B to show");
    const size_t count = (size_t)image->width * image->height;
    const struct filmic f = make_filmic(tone->white);
    struct tables *t = NULL;
    if (tone->curve == KILN_TONE_FILMIC && count > ENTRIES) {
        const int status = kiln_allocate(&t, 1, sizeof *t, "a tone curve", error);
        if (status != KILN_OK)
            return status;
        make_tables(t, &f);
    }
#pragma omp parallel for schedule(static) if (count > KILN_IMAGE_ALONE)
    for (size_t i = 0; i < count; i++) {
        const float rgb[3] = {planes[0][i], planes[1][i], planes[2][i]};
        if (t != NULL && map_by_tables(t, tone->exposure, rgb, &bytes[3 * i]))
            continue;
        double code[3];
        map_color(tone, &f, rgb, code);
        for (size_t c = 0; c < 3; c++)
            bytes[3 * i + c] = (uint8_t)(255.0 * code[c] + 0.5);
    }
    kiln_free(&t);
    return KILN_OK;
}

int kiln_png_write(const char *directory, const char *name, const struct kiln_image *image,
                   const struct kiln_tone *tone, const char *description, struct kiln_error *error)
{
    uint8_t *bytes = NULL;
    int status;
    KILN_TRY(kiln_allocate(&bytes, (size_t)image->width * image->height * 3, 1, "a picture's bytes", error));
    KILN_TRY(kiln_tone_map(image, tone, bytes, error));
    KILN_TRY(kiln_png_write_bytes(directory, name, bytes, image->width, image->height, description, error));
end:
    kiln_free(&bytes);
    return status;
}
