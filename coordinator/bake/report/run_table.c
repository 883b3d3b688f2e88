#include "coordinator/bake/report/run_table.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "coordinator/bake/light/density_check.h"
#include "coordinator/bake/report/reached.h"
#include "coordinator/integrate/quantity.h"
#include "coordinator/run/phases.h"
#include "coordinator/run/progress.h"
#include "worker/base/color.h"
#include "worker/base/text.h"

enum { ROWS = KILN_PHASES_MAX + 1, COLUMNS = 6, CELL = 32, NAMED = 3 };
static const double NOTE_IMBALANCE = 0.05, NOTE_LAMPS = 0.01, NOTE_KEPT = 0.25, NOTE_FILES = 0.10, NOTE_SECONDS = 1.0,
                    NOTE_FILES_SECONDS = 5.0, NOTE_LOST = 0.01, NOTE_ABOVE = 0.025, NOTE_BORDERS = 0.01,
                    NOTE_TAIL = 2e-3, NOTE_TILE_TAIL = 5e-2, NOTE_SIGMAS = 5.0,
                    FAINTEST = 1e-35; /* W/m2; the smallest normal float is 1.2e-38 */

struct advice {
    const char *phase, *text;
};

static const char *const step_advice = "try a smaller --cell-size, which distributes the cells more evenly";
static const struct advice balance_advice[] = {
    {"preview", "one rank draws it; --no-preview leaves it out"},
};
static const struct advice file_advice[] = {
    {"lightmaps", "more ranks or threads pack them sooner, --half makes them smaller"},
    {"kiln.h5", "more ranks or threads pack it sooner"},
    {"volume.hdf", "a wider --probe-spacing makes it smaller, --samples-probe 0 leaves it out"},
    {"checkpoints", "a longer --checkpoint-every writes fewer of them"},
};
enum {
    BALANCE_ADVICE = sizeof balance_advice / sizeof *balance_advice,
    FILE_ADVICE = sizeof file_advice / sizeof *file_advice
};

static const char *name_of(const json_t *phase)
{
    const char *name = json_string_value(json_object_get(phase, "name"));
    return name != NULL ? name : "";
}

static double seconds_of(const json_t *phase, const char *which)
{
    return json_number_value(json_object_get(json_object_get(phase, "seconds"), which));
}

/* Seconds of the bake, with those of runs before a restart. */
static double whole(const json_t *report)
{
    return json_number_value(json_object_get(report, "seconds")) +
           json_number_value(json_object_get(report, "seconds_before"));
}

/* Whether imbalance of the phase means anything; it does not for communication, waiting and "other". */
static bool is_work(const char *name)
{
    return strcmp(name, "exchange") != 0 && strcmp(name, "waiting") != 0 && strcmp(name, "other") != 0;
}

static const char *advice_for(const struct advice *advice, size_t count, const char *phase, const char *otherwise)
{
    for (size_t i = 0; i < count; i++)
        if (strcmp(advice[i].phase, phase) == 0)
            return advice[i].text;
    return otherwise;
}

/* ---- notes ---- */

static void note_imbalance(const json_t *report, json_t *notes)
{
    const json_t *worst = NULL;
    double most = NOTE_SECONDS;
    size_t index;
    const json_t *phase;
    json_array_foreach(json_object_get(report, "phases"), index, phase)
    {
        const double lost = seconds_of(phase, "max") - seconds_of(phase, "avg");
        if (is_work(name_of(phase)) && lost > most && lost > NOTE_IMBALANCE * seconds_of(phase, "avg")) {
            most = lost;
            worst = phase;
        }
    }
    if (worst != NULL)
        (void)json_array_append_new(
            notes, json_sprintf("%s: the slowest rank took %.0f %% longer than the mean, which costs %.1f s a rank; %s",
                                name_of(worst), 100.0 * json_number_value(json_object_get(worst, "imbalance")), most,
                                advice_for(balance_advice, BALANCE_ADVICE, name_of(worst),
                                           kiln_is_phase_of_steps(name_of(worst))
                                               ? step_advice
                                               : "--trace FILE.json shows which rank, and when")));
}

static void note_files(const json_t *report, json_t *notes)
{
    const char *worst = "";
    double sum = 0.0, most = 0.0;
    size_t index;
    const json_t *phase;
    json_array_foreach(json_object_get(report, "phases"), index, phase)
    {
        const double seconds = seconds_of(phase, "avg");
        if (advice_for(file_advice, FILE_ADVICE, name_of(phase), NULL) == NULL)
            continue;
        sum += seconds;
        if (seconds > most) {
            most = seconds;
            worst = name_of(phase);
        }
    }
    if (sum > NOTE_FILES_SECONDS && sum > NOTE_FILES * whole(report))
        (void)json_array_append_new(notes,
                                    json_sprintf("files took %.0f %% of the time (%.1f s), most of it %s (%.1f s); %s",
                                                 100.0 * sum / whole(report), sum, worst, most,
                                                 advice_for(file_advice, FILE_ADVICE, worst, "")));
}

static double luminance_of(const json_t *energy, const char *term)
{
    const json_t *array = json_object_get(energy, term);
    double rgb[3];
    for (size_t c = 0; c < 3; c++)
        rgb[c] = json_number_value(json_array_get(array, c));
    return kiln_luminance(rgb);
}

static double number_of(const json_t *object, const char *key)
{
    return json_number_value(json_object_get(object, key));
}

/* Whether the report has an energy ledger. A bake for some views has none: it does not know where all light went. */
static bool has_ledger(const json_t *report) { return json_object_get(report, "visible_from") == NULL; }

/* Returns the light that reached surfaces. For a bake for some views: only light straight from the lights. */
static double light_met(const json_t *report)
{
    const json_t *energy = json_object_get(report, "energy");
    if (!has_ledger(report))
        return luminance_of(json_object_get(json_object_get(energy, "first_light"), "direct"), "traced");
    return luminance_of(energy, "absorbed") + luminance_of(energy, "glass") + luminance_of(energy, "gloss") +
           luminance_of(energy, "left_over");
}

/* Notes light that reached surfaces but is missing from the lightmaps. */
static void note_lost_light(const json_t *report, json_t *notes)
{
    const json_t *energy = json_object_get(report, "energy");
    const double blocked = number_of(energy, "lost_on_backs"), met = light_met(report) + blocked;
    if (met > 0.0 && blocked > NOTE_LOST * met)
        (void)json_array_append_new(
            notes,
            json_sprintf(
                "%.1f %% of the light that reached surfaces hit backs of single-sided ones and is lost (%.3g W); %s",
                100.0 * blocked / met, blocked,
                number_of(json_object_get(report, "scene"), "enclosed_lights") > 0.0
                    ? "there are lights enclosed in meshes, which a note names"
                    : "flip those faces, or make their materials double-sided"));
}

/* Notes that caustics were left out: a first round found them smaller than the error of the other light. */
static void note_left_out(const json_t *report, json_t *notes)
{
    const json_t *tried = json_object_get(json_object_get(report, "materials"), "tried");
    if (json_is_true(json_object_get(tried, "left_out")))
        (void)json_array_append_new(
            notes,
            json_sprintf("caustics are left out: a first round of light paths has found that they bring %.2g %% of "
                         "the light, and the error of the rest is about %.2g %%; --caustics vcm has them",
                         100.0 * number_of(tried, "brings"), 100.0 * number_of(tried, "error_of_the_rest")));
}

/* Notes light of lamps that mirrors and glass send on but this bake leaves out. */
static void note_unfound_light(const json_t *report, json_t *notes)
{
    const json_t *energy = json_object_get(report, "energy");
    const double unfound = luminance_of(energy, "unfound"),
                 met = unfound + (has_ledger(report) ? luminance_of(energy, "absorbed") : light_met(report));
    const char *caustics = json_string_value(json_object_get(json_object_get(report, "materials"), "caustics"));
    const bool gathers = caustics != NULL && strcmp(caustics, "none") != 0;
    if (met > 0.0 && unfound > NOTE_LOST * met)
        (void)json_array_append_new(
            notes,
            json_sprintf("%.1f %% of the light that surfaces take up comes to them from lamps by way of mirrors, "
                         "gloss and glass, and is left out (%.3g W): %s",
                         100.0 * unfound / met, unfound,
                         gathers ? "rays from surfaces meet no lamp without size by mirrors and smooth glass; make "
                                   "such lamps surfaces that emit"
                                 : "--caustics gather would find what it can"));
}

/* Notes light that enters a material and never comes out. */
static void note_kept_light(const json_t *report, json_t *notes)
{
    const json_t *energy = json_object_get(report, "energy");
    const double emitted = luminance_of(energy, "emitted"), kept = luminance_of(energy, "gloss");
    if (emitted > 0.0 && kept > NOTE_KEPT * emitted)
        (void)json_array_append_new(
            notes,
            json_sprintf("%.1f %% of what the lamps emit ends in mirrors, gloss and glass (%.3g W): coloured ones "
                         "take it up, and glass keeps in what total reflection turns back again and again",
                         100.0 * kept / emitted, kept));
}

/* Notes objects that receive only a part of the caustics. */
static void note_receivers(const json_t *report, json_t *notes)
{
    const double count = number_of(json_object_get(report, "materials"), "receivers_gather");
    if (count > 0.0)
        (void)json_array_append_new(
            notes,
            json_sprintf("no light path meets receiver-only objects (%.0f here): of caustics they have what rays "
                         "find, without what points, spots and suns send by mirrors and smooth glass; role: both "
                         "gives them all",
                         count));
}

/* Notes that indirect light is biased, because rays end at a range. */
static void note_bias(const json_t *report, json_t *notes)
{
    const json_t *probes = json_object_get(report, "radiance_probes");
    if (probes != NULL)
        (void)json_array_append_new(
            notes, json_sprintf("indirect light is biased: rays end at %.4g m, and %.0f radiance probes, %.3g m apart, "
                                "answer for what is farther (%.1f MiB; %.0f moved out of geometry, %.0f off)",
                                number_of(json_object_get(report, "job"), "tracing_range"), number_of(probes, "probes"),
                                number_of(probes, "spacing"), number_of(probes, "bytes") / 0x1p20,
                                number_of(probes, "moved"), number_of(probes, "off")));
}

/* Returns the first known cause, by the report, of a ledger that does not balance. */
static const char *cause_of_imbalance(const json_t *report)
{
    const json_t *points = json_object_get(report, "points"), *tail = json_object_get(report, "tail");
    const double count = number_of(points, "count"), area = number_of(points, "area"),
                 whole_area = number_of(points, "geometry_area");
    const double emitted = luminance_of(json_object_get(report, "energy"), "emitted");
    if (json_is_true(json_object_get(json_object_get(report, "job"), "clamp")))
        return "--clamp cuts off what near patches bring, and rows are not closed";
    if (whole_area > 0.0 && emitted / whole_area < FAINTEST)
        return "the light is so faint that floats lose it; make the lights brighter, by 1e10 for example";
    if (json_is_true(json_object_get(tail, "diverges")) || number_of(tail, "error") > NOTE_TAIL)
        return "the bounces have not converged";
    if (fabs(area - whole_area) > 0.5 * NOTE_LOST * whole_area)
        return "surfaces have no texels of their own, or too many; finer lightmaps have them, and kiln check names "
               "the objects";
    if (number_of(points, "doubled_area") > 0.5 * NOTE_LOST * whole_area)
        return "surfaces that are there twice take light twice; remove one of each, which a warning names";
    if (number_of(points, "shared") > NOTE_LOST * count)
        return "charts share texels; finer lightmaps part them, and so does --shared-texels repack";
    if (number_of(points, "invalid") > NOTE_LOST * count)
        return "texels that are partly buried stand for surface that light reaches; finer lightmaps tell the two apart";
    return "lightmaps too coarse for their surfaces, or surfaces without texels, which kiln check names, do that";
}

/* Notes a target error that was missed though links were opened. */
static void note_target_of_links(const json_t *report, json_t *notes)
{
    const json_t *error = json_object_get(report, "error");
    const double target = number_of(error, "target"), above = number_of(error, "above_target");
    char parts[120] = "";
    if (json_object_get(error, "target") == NULL || json_object_get(error, "rounds") != NULL || !(above > NOTE_ABOVE))
        return;
    if (json_object_get(error, "above_target_direct") != NULL)
        (void)snprintf(parts, sizeof parts, ": direct light's alone is in %.1f %%, that of links in %.1f %%",
                       100.0 * number_of(error, "above_target_direct"),
                       100.0 * number_of(error, "above_target_indirect"));
    (void)json_array_append_new(
        notes, json_sprintf("--target-error %.4g is not reached where %.1f %% of the surface points lie, though links "
                            "were opened as far as it takes%s; more --samples-direct take noise of direct light, and "
                            "smaller texels (--texels-per-metre) what one ray a texel misses",
                            target, 100.0 * above, parts));
}

/* Notes an error of published light that was asked for and not reached. What helps: reached.h. */
static void note_published(const json_t *report, json_t *notes)
{
    const json_t *error = json_object_get(report, "error");
    const double asked = number_of(error, "asked"), reached = number_of(error, "published");
    if (json_object_get(error, "published") != NULL && json_object_get(error, "time") == NULL && reached > asked)
        (void)json_array_append_new(
            notes,
            json_sprintf("--quality %.3g%% is not reached: 95 %% of the texels are less than %.2g %% off%s",
                         100.0 * asked, 100.0 * reached,
                         json_is_true(json_object_get(error, "out_of_time")) ? ", as time was over"
                         : json_is_true(json_object_get(error, "most_samples"))
                             ? "; rounds ended as texels have had the most samples that one gets, but with --time, "
                               "which gives them more"
                             : ""));
}

/* Notes, for a bake for some views, that most surfaces may have no light. */
static void note_views(const json_t *report, json_t *notes)
{
    const json_t *v = json_object_get(report, "visible_from");
    const double valid = number_of(v, "valid"), seen = number_of(v, "seen");
    if (v != NULL && valid > 0.0)
        (void)json_array_append_new(
            notes, json_sprintf("%.1f %% of the surface points are seen from %.0f views and have light of their own; "
                                "%.1f %% were lit for what is seen alone, and no ledger of energy is closed",
                                100.0 * seen / valid, number_of(v, "views"), 100.0 * number_of(v, "reached") / valid));
}

/* A sky dome has no probes. */
static void note_volume(const json_t *report, json_t *notes)
{
    const json_t *left_out = json_object_get(json_object_get(report, "volume"), "left_out");
    const double more = number_of(left_out, "objects") - 1.0;
    char name[96], others[64] = "";
    if (left_out == NULL)
        return;
    kiln_text_plain(name, sizeof name, json_string_value(json_object_get(left_out, "largest")));
    if (more > 0.0)
        (void)snprintf(others, sizeof others, " and %.0f smaller source%s", more, more > 1.0 ? "s" : "");
    (void)json_array_append_new(notes,
                                json_sprintf("the irradiance volume spans what receives light, not '%s'%s around it, "
                                             "of which it would be more than four times as long; --volume-bounds says "
                                             "what it is to span",
                                             name, others));
}

/* Notes an energy ledger whose residual exceeds its error. */
static void note_imbalanced_energy(const json_t *report, json_t *notes)
{
    const json_t *energy = json_object_get(report, "energy");
    const double emitted = luminance_of(energy, "emitted"), residual = number_of(energy, "residual"),
                 off = fabs(residual), error = number_of(energy, "error");
    const double met = light_met(report) + luminance_of(energy, "blocked");
    if (json_object_get(report, "radiance_probes") != NULL)
        return; /* the ledger does not count the light that probes stand in for */
    const bool of_met = met > off;
    const double base = of_met ? met : emitted;
    if (has_ledger(report) && base > 0.0 && off > NOTE_LOST * base && off > NOTE_SIGMAS * error)
        (void)json_array_append_new(
            notes, json_sprintf("the energy ledger is off by %.1f %% of the light that %s (%.3g W %s): %s",
                                100.0 * off / base, of_met ? "reached surfaces" : "was emitted", off,
                                residual > 0.0 ? "missing" : "too much", cause_of_imbalance(report)));
}

/* Bright spots of lamps' textures that samples have missed, or found too often. */
static void note_missed_lamps(const json_t *report, json_t *notes)
{
    const json_t *lamps = json_object_get(json_object_get(report, "energy"), "lamps_with_textures");
    const double integral = luminance_of(lamps, "integral"), sampled = luminance_of(lamps, "sampled"),
                 off = fabs(sampled - integral);
    if (lamps != NULL && off > NOTE_LAMPS * integral && off > NOTE_SIGMAS * number_of(lamps, "error"))
        (void)json_array_append_new(
            notes,
            json_sprintf("lamps with textures emit %.4g W by the textures, and samples of them find %.4g W: "
                         "they have more bright spots than kiln cuts lamps into parts; make the textures coarser, "
                         "or give bright spots triangles of their own",
                         integral, sampled));
}

/* Names the density, or the size of lightmaps, at which charts lie two texels apart. */
static void name_padding(const json_t *borders, char *text, size_t size)
{
    const double factor = number_of(borders, "padding_factor"), density = number_of(borders, "texels_per_metre");
    if (factor < 0.0)
        (void)snprintf(text, size, "%s",
                       "no density would do, since charts touch or lightmaps would be larger than --lightmap-max; ");
    else if (factor > 0.0 && density > 0.0)
        (void)snprintf(text, size, "--texels-per-metre %.3g would leave less than 1 %%; ", factor * density);
    else if (factor > 0.0)
        (void)snprintf(text, size, "lightmaps %.3g times as large a side would leave less than 1 %%; ", factor);
    else
        text[0] = '\0';
}

/* Light that bleeds between charts, if that affects more than 1 % of their borders. */
static void note_borders(const json_t *report, json_t *notes)
{
    const json_t *borders = json_object_get(report, "borders");
    const double share = number_of(borders, "disturbed_texels") / number_of(borders, "texels");
    char padding[160];
    if (!(share > NOTE_BORDERS))
        return;
    name_padding(borders, padding, sizeof padding);
    (void)json_array_append_new(
        notes,
        json_sprintf(
            "along %.2g %% of the borders of charts, in %.0f lightmaps, light of another chart is read, since less "
            "than two texels lie between them; %s--repack packs such charts again",
            100.0 * share, number_of(borders, "disturbed_lightmaps"), padding));
}

/* The place where light goes on for the longest, as the end of a sentence; empty if none is known. */
static void name_pocket(const json_t *tail, char *text, size_t size)
{
    const json_t *pocket = json_object_get(tail, "pocket");
    char object[96], material[96];
    text[0] = '\0';
    if (pocket == NULL)
        return;
    kiln_text_plain(object, sizeof object, json_string_value(json_object_get(pocket, "object")));
    kiln_text_plain(material, sizeof material, json_string_value(json_object_get(pocket, "material")));
    (void)snprintf(text, size, " (most in '%s', material '%s')", object, material);
}

/* Notes an estimate of the later bounces (tail) whose error is too large. */
static void note_tail(const json_t *report, json_t *notes)
{
    const json_t *tail = json_object_get(report, "tail");
    const double error = number_of(tail, "error"), tile_error = number_of(tail, "tile_error");
    /* later rounds go on from that light (integrate/parts/parts.h), and their error is judged */
    const bool goes_on = number_of(json_object_get(report, "error"), "rounds") > 1.0 &&
                         json_object_get(json_object_get(report, "error"), "published") != NULL;
    /* light that is off by less than a tenth of the error asked for does not matter */
    const double most = fmax(NOTE_TAIL, 0.1 * number_of(json_object_get(report, "error"), "asked"));
    char pocket[240];
    name_pocket(tail, pocket, sizeof pocket);
    if (json_is_true(json_object_get(tail, "diverges")))
        (void)json_array_append_new(
            notes,
            json_sprintf("the bounces diverge: a closed place reflects all light%s, so that its light has no end "
                         "and the result no meaning; lower the albedo of its materials",
                         pocket));
    else if (error > most)
        (void)json_array_append_new(
            notes, json_sprintf("the bounces have not converged: their sum may be off by %.3g %%, since materials "
                                "reflect nearly all light%s; a lower albedo of these ends it (white paint has 0.8 to "
                                "0.9), and --bounces N --tail with a larger N counts more of them",
                                100.0 * error, pocket));
    else if (tile_error > NOTE_TILE_TAIL && !goes_on)
        (void)json_array_append_new(
            notes, json_sprintf("in small closed places light goes on for longer than bounces did%s: texels there may "
                                "be off by %.3g %%, while objects' means are right; a lower albedo of that material "
                                "ends it",
                                pocket, 100.0 * tile_error));
}

/* Objects whose texels are too coarse: the worst three by name. */
static void note_density(const json_t *report, json_t *notes)
{
    const json_t *objects = json_object_get(json_object_get(report, "density"), "objects"), *object;
    const size_t count = json_array_size(objects);
    char names[400] = "", name[96];
    size_t index, used = 0;
    json_array_foreach(objects, index, object)
    {
        if (index == NAMED)
            break;
        kiln_text_plain(name, sizeof name, json_string_value(json_object_get(object, "name")));
        used += (size_t)snprintf(names + used, sizeof names - used, "%s'%s' by about %.0f %%", index == 0 ? "" : ", ",
                                 name, 100.0 * number_of(object, "moves_at_double_density"));
    }
    if (count > NAMED)
        (void)snprintf(names + used, sizeof names - used, ", and %zu more (run.json)", count - NAMED);
    if (count > 0)
        (void)json_array_append_new(
            notes,
            json_sprintf("texels twice as fine would change the mean light of %zu object%s by more than %.0f %%: "
                         "%s; raise --texels-per-metre for all, or density-scale for these",
                         count, count == 1 ? "" : "s", 100.0 * KILN_DENSITY_MOST, names));
}

json_t *kiln_run_notes(const json_t *report)
{
    json_t *notes = json_array();
    note_lost_light(report, notes);
    note_left_out(report, notes);
    note_unfound_light(report, notes);
    note_kept_light(report, notes);
    note_receivers(report, notes);
    note_published(report, notes);
    note_target_of_links(report, notes);
    note_views(report, notes);
    note_volume(report, notes);
    note_imbalanced_energy(report, notes);
    note_missed_lamps(report, notes);
    note_bias(report, notes);
    note_tail(report, notes);
    note_imbalance(report, notes);
    note_files(report, notes);
    note_borders(report, notes);
    note_density(report, notes);
    return notes;
}

/* ---- the table ---- */

static void phase_row(char text[COLUMNS][CELL], const json_t *phase, double all)
{
    static const char *const which[] = {"min", "avg", "max"};
    (void)snprintf(text[0], CELL, "%s", name_of(phase));
    for (size_t k = 0; k < 3; k++)
        (void)snprintf(text[1 + k], CELL, "%.3f", seconds_of(phase, which[k]));
    (void)snprintf(text[4], CELL, "%.1f %%", 100.0 * json_number_value(json_object_get(phase, "imbalance")));
    (void)snprintf(text[5], CELL, "%.1f %%", all > 0.0 ? 100.0 * seconds_of(phase, "avg") / all : 0.0);
    if (!is_work(text[0]))
        text[4][0] = '\0';
}

/* Prints the phases. Of one rank, all columns of seconds are the same. */
static void print_phases(FILE *stream, const json_t *report)
{
    static const char *const of_one[] = {"phase", "seconds", "of all"};
    static const double LEAST_SECONDS = 5e-4; /* which are printed as 0.000 */
    enum { OF_ONE = sizeof of_one / sizeof *of_one };
    const bool one = json_integer_value(json_object_get(report, "ranks")) == 1;
    const size_t columns = one ? OF_ONE : COLUMNS;
    char text[ROWS][COLUMNS][CELL];
    const char *cells[ROWS * COLUMNS] = {"phase", "least s", "mean s", "slowest s", "imbalance", "of all"};
    size_t rows = 1, index;
    const json_t *phase;
    for (size_t c = 0; one && c < columns; c++)
        cells[c] = of_one[c];
    json_array_foreach(json_object_get(report, "phases"), index, phase)
    {
        if (rows == ROWS)
            break;
        if (one && seconds_of(phase, "avg") < LEAST_SECONDS)
            continue; /* of one rank, which waits for none */
        phase_row(text[rows], phase, whole(report));
        for (size_t c = 0; c < columns; c++)
            cells[rows * columns + c] = text[rows][one && c > 1 ? COLUMNS - 1 : c];
        rows++;
    }
    kiln_table_print(stream, cells, rows, columns, 0x3e);
}

static void print_time(FILE *stream, const json_t *report)
{
    const json_int_t restarts = json_integer_value(json_object_get(report, "restarts"));
    const json_int_t ranks = json_integer_value(json_object_get(report, "ranks")),
                     threads = json_integer_value(json_object_get(report, "threads"));
    char text[48];
    (void)fprintf(stream, "\n%s on %lld rank%s of %lld thread%s", kiln_duration_text(whole(report), text, sizeof text),
                  (long long)ranks, ranks == 1 ? "" : "s", (long long)threads, threads == 1 ? "" : "s");
    if (restarts > 0)
        (void)fprintf(stream, ", in %lld runs", (long long)restarts + 1);
    (void)fprintf(stream, "; %.2f Mrays/s\n", json_number_value(json_object_get(report, "mrays_per_second")));
}

static void print_memory(FILE *stream, const json_t *report)
{
    const json_t *memory = json_object_get(report, "memory");
    const json_int_t asked = json_integer_value(json_object_get(memory, "asked_node"));
    (void)fprintf(stream, "peak memory of a rank %.1f MiB",
                  (double)json_integer_value(json_object_get(memory, "peak_rank")) / 1048576.0);
    if (asked > 0)
        (void)fprintf(stream, "; Slurm gives %.1f MiB a node", (double)asked / 1048576.0);
    (void)fputc('\n', stream);
}

static void print_reached(FILE *stream, const json_t *report)
{
    const json_t *points = json_object_get(report, "points");
    const double count = json_number_value(json_object_get(points, "count")),
                 invalid = json_number_value(json_object_get(points, "invalid"));
    (void)fprintf(stream, "%.0f surface points, %.2f %% of them buried", count,
                  count > 0.0 ? 100.0 * invalid / count : 0.0);
    if (has_ledger(report))
        (void)fprintf(stream, "; energy balanced to %.3f %% of what was emitted",
                      100.0 * number_of(json_object_get(report, "energy"), "relative_residual"));
    (void)fputc('\n', stream);
    kiln_reached_print(stream, report);
}

void kiln_run_table(FILE *stream, const json_t *report)
{
    size_t index;
    const json_t *note;
    const char *output = json_string_value(json_object_get(report, "output"));
    (void)fputc('\n', stream);
    print_phases(stream, report);
    print_time(stream, report);
    print_memory(stream, report);
    print_reached(stream, report);
    kiln_print(stream, "results in   %s\n", output != NULL ? output : "?");
    json_array_foreach(json_object_get(report, "notes"), index, note)
        kiln_print(stream, "NOTE %s\n", json_string_value(note));
}
