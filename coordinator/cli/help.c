#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>

#include "coordinator/cli/help_text.h"
#include "coordinator/cli/studies.h"
#include "coordinator/job/options.h"
#include "coordinator/view/show.h"

/* Text that is wrapped between words. */
struct page {
    FILE *stream;
    size_t width, column; /* characters of a line, and characters on the present line so far */
};

/* Returns the width of a page: that of COLUMNS, or of the terminal, or 80 if neither is known; at most 100, for
 * readability. */
static size_t width_of(FILE *stream)
{
    enum { UNKNOWN = 80, LEAST = 60, MOST = 100 };
    struct winsize size = {0};
    const char *columns = getenv("COLUMNS");
    long width = columns != NULL ? strtol(columns, NULL, 10) : 0;
    if (width <= 0 && ioctl(fileno(stream), TIOCGWINSZ, &size) == 0)
        width = size.ws_col;
    return width <= 0 ? UNKNOWN : width < LEAST ? LEAST : width > MOST ? MOST : (size_t)width;
}

static void pad(struct page *page, size_t column)
{
    for (; page->column < column; page->column++)
        (void)fputc(' ', page->stream);
}

/* Ends the line with `end` and begins another one at `indent`. */
static void turn(struct page *page, const char *end, size_t indent)
{
    (void)fprintf(page->stream, "%s\n", end);
    page->column = 0;
    pad(page, indent);
}

static void put(struct page *page, const char *word, size_t length)
{
    (void)fprintf(page->stream, "%.*s", (int)length, word);
    page->column += length;
}

/* Writes a word that is longer than a line. It is broken after a '|' if possible. */
static void put_long(struct page *page, const char *word, size_t length, size_t indent)
{
    while (page->column + length > page->width) {
        size_t cut = page->width > page->column ? page->width - page->column : 0;
        while (cut > 0 && word[cut - 1] != '|')
            cut--;
        if (cut == 0)
            break;
        put(page, word, cut);
        turn(page, "", indent);
        word += cut;
        length -= cut;
    }
    put(page, word, length);
}

/* Writes words, starting at the present column. Further lines begin at `indent`; broken lines end with `end`. */
static void flow(struct page *page, const char *text, size_t indent, const char *end)
{
    bool first = true;
    for (const char *word = text; *word != '\0';) {
        const size_t length = strcspn(word, " ");
        if (!first && page->column + 1 + length + strlen(end) > page->width)
            turn(page, end, indent);
        else if (!first)
            put(page, " ", 1);
        put_long(page, word, length, indent);
        first = false;
        word += length + strspn(word + length, " ");
    }
}

static void paragraph(struct page *page, size_t at, const char *text, size_t indent)
{
    pad(page, at);
    flow(page, text, indent, "");
    turn(page, "", 0);
}

/* Writes a name in the left column and its sentence in the right one, or below it if the name is too long. */
static void entry(struct page *page, const char *name, size_t column, const char *sentence)
{
    const size_t right = page->width < 72 ? 8 : column;
    pad(page, 2);
    flow(page, name, 6, "");
    if (page->column + 2 > right)
        turn(page, "", right);
    pad(page, right);
    paragraph(page, 0, sentence, right);
}

static void print_option(struct page *page, const struct kiln_command *command, const struct kiln_option *option)
{
    char head[KILN_HELP_HEAD], sentence[KILN_HELP_SENTENCE];
    kiln_help_head(option, head);
    kiln_help_sentence(option, command, sentence);
    entry(page, head, 30, sentence);
}

static void print_qualities(struct page *page)
{
    (void)fprintf(page->stream, "\n%-16s%7s%10s%8s%10s%7s\n", "--quality", "error", "or direct", "bounce", "indirect",
                  "probe");
    for (size_t i = 0; i < kiln_quality_count; i++)
        (void)fprintf(page->stream, "  %-14s%5g %%%10u%8u%10u%7u\n", kiln_qualities[i].name, kiln_qualities[i].error,
                      kiln_qualities[i].samples_direct, kiln_qualities[i].samples_bounce,
                      kiln_qualities[i].samples_indirect, kiln_qualities[i].samples_probe);
}

/* The keys of changes: coordinator/job/changes.h, coordinator/import/changes.c. */
static void print_changes(struct page *page)
{
    static const char *const lines[] = {"lights: {NAME: {scale: 0.5, intensity: [R, G, B], on: false}}",
                                        "materials: {NAME: {emission: [R, G, B], emission-scale: 2, on: false, "
                                        "albedo: [R, G, B]}}",
                                        "environment: {scale: 2, radiance: [R, G, B], rotation: DEGREES, on: false}"};
    turn(page, "", 0);
    paragraph(page, 0, "CHANGES.yaml names what changes; names may be patterns (lamp*), numbers one or three", 0);
    for (size_t i = 0; i < sizeof lines / sizeof *lines; i++)
        paragraph(page, 2, lines[i], 6);
}

/* Names that --show takes, with their units and sentences. */
static void print_shows(struct page *page)
{
    const char *name, *unit, *sentence;
    turn(page, "", 0);
    paragraph(page, 0, "What --show shows, and its unit (light: that of the bake)", 0);
    for (size_t i = 0; kiln_show_row(i, &name, &unit, &sentence); i++) {
        char head[64];
        (void)snprintf(head, sizeof head, "%-18s %s", name, unit[0] != '\0' ? unit : "light");
        pad(page, 2);
        put(page, head, strlen(head));
        entry(page, "", 36, sentence);
    }
}

/* ---- a command ---- */

/* Options that most users need first. Help lists them before the groups. */
static const char *const leading[] = {"quality", "texels-per-metre", "output"};

static bool leads(const struct kiln_option *option)
{
    for (size_t i = 0; i < sizeof leading / sizeof *leading; i++)
        if (strcmp(option->name, leading[i]) == 0)
            return true;
    return false;
}

static size_t print_leading(struct page *page, const struct kiln_command *command, bool all)
{
    size_t count = 0;
    for (size_t i = 0; i < sizeof leading / sizeof *leading; i++) {
        const struct kiln_option *option = kiln_option_find_for(leading[i], command->bit);
        if (!kiln_help_has(command, option, all))
            continue;
        if (count++ == 0)
            paragraph(page, 0, "Result", 0);
        print_option(page, command, option);
    }
    return count;
}

/* Prints the options by groups; returns how many there are. */
static size_t print_options(struct page *page, const struct kiln_command *command, bool all)
{
    turn(page, "", 0);
    size_t count = print_leading(page, command, all);
    const char *group = NULL;
    for (size_t i = 0; i < kiln_option_count; i++) {
        const struct kiln_option *option = &kiln_options[i];
        if (!kiln_help_has(command, option, all) || leads(option))
            continue;
        if (group == NULL || strcmp(group, option->group) != 0) {
            if (count > 0)
                turn(page, "", 0);
            paragraph(page, 0, option->group, 0);
        }
        group = option->group;
        print_option(page, command, option);
        count++;
    }
    return count;
}

static void print_examples(struct page *page, const struct kiln_command *command, size_t most)
{
    turn(page, "", 0);
    paragraph(page, 0, most == 1 || command->examples[1] == NULL ? "Example" : "Examples", 0);
    for (size_t i = 0; i < most && command->examples[i] != NULL; i++) {
        pad(page, 2);
        flow(page, command->examples[i], 6, " \\");
        turn(page, "", 0);
    }
}

static size_t count_options(const struct kiln_command *command)
{
    size_t count = 0;
    for (size_t i = 0; i < kiln_option_count; i++)
        count += kiln_help_has(command, &kiln_options[i], true);
    return count;
}

/* A sentence of what the command does, and its usage line. */
static void print_summary(struct page *page, const struct kiln_command *command)
{
    char text[200];
    (void)snprintf(text, sizeof text, "kiln %s: %s.", command->name, command->summary);
    paragraph(page, 0, text, 0);
    (void)snprintf(text, sizeof text, "Usage: kiln %s %s [options]", command->name, command->arguments);
    turn(page, "", 0);
    paragraph(page, 0, text, 6);
}

static void print_rest(struct page *page, const struct kiln_command *command, size_t shown)
{
    char text[200];
    const size_t count = count_options(command);
    if (shown < count)
        (void)snprintf(text, sizeof text, "These are %zu of %zu options: kiln %s --help all shows the rest.", shown,
                       count, command->name);
    else
        (void)snprintf(text, sizeof text, "These are all options of kiln %s; kiln --help lists the other commands.",
                       command->name);
    turn(page, "", 0);
    paragraph(page, 0, text, 0);
}

/* Implements kiln_study_tell; `context` is the page. */
static void print_study(void *context, const char *name, const char *sentence) { entry(context, name, 18, sentence); }

static void print_studies(struct page *page)
{
    struct kiln_error error = {{0}};
    turn(page, "", 0);
    paragraph(page, 0, "Studies, which are in Python and have options of their own: kiln bench NAME --help", 0);
    if (kiln_studies_list(print_study, page, &error) != KILN_OK)
        paragraph(page, 2, error.message, 2);
}

static void command_screen(struct page *page, const struct kiln_command *command, bool all)
{
    enum { FEW = 2, EVERY = 12 };
    print_summary(page, command);
    print_examples(page, command, all ? EVERY : FEW);
    const size_t shown = print_options(page, command, all);
    if ((kiln_option_find("quality")->commands & command->bit) != 0)
        print_qualities(page);
    if (command->bit == KILN_FOR_RELIGHT)
        print_changes(page);
    if (command->bit == KILN_FOR_VIEW && all)
        print_shows(page);
    if (command->bit == KILN_FOR_BENCH)
        print_studies(page);
    if (command->scene) {
        turn(page, "", 0);
        paragraph(page, 0,
                  "A job file is YAML: the same names without the dashes, and `scene`, or `parts` for a scene of many "
                  "files, `- {name: house, file: house.glb, at: {translation: [10, 0, 0]}}`; paths in it are relative "
                  "to it. Later wins: defaults, --quality, the job file, the command line.",
                  0);
    }
    print_rest(page, command, shown);
}

static void overview(struct page *page)
{
    static const char *const examples[] = {"kiln generate cornell -o cornell.glb", "kiln bake cornell.glb -o out",
                                           "kiln view out -o view.png"};
    paragraph(page, 0, "kiln " KILN_VERSION " bakes the light of a static scene into lightmaps and a volume.", 0);
    for (size_t i = 0; i < sizeof examples / sizeof *examples; i++)
        paragraph(page, 2, examples[i], 6);
    paragraph(page, 0, "Commands", 0);
    for (size_t i = 0; i < kiln_command_count; i++)
        entry(page, kiln_commands[i].name, 12, kiln_commands[i].summary);
    paragraph(page, 0, "kiln COMMAND --help shows what most need, kiln COMMAND --help all the rest.", 0);
}

void kiln_help(FILE *stream, const struct kiln_command *command, bool all)
{
    struct page page = {.stream = stream, .width = width_of(stream)};
    if (command != NULL) {
        command_screen(&page, command, all);
        return;
    }
    overview(&page);
    for (size_t i = 0; all && i < kiln_command_count; i++) {
        turn(&page, "", 0);
        command_screen(&page, &kiln_commands[i], true);
    }
}
