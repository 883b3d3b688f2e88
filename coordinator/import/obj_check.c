#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/import/obj.h"

enum { TOKEN_LENGTH = 128 };

struct walk {
    const char *scene;
    const unsigned char *at, *end;
    uint64_t line;
    uint64_t counts[3]; /* v, vt, vn */
    uint64_t faces;
    struct kiln_error *error;
};

static const char *const kinds[3] = {"v", "vt", "vn"};

static bool blank(unsigned char c) { return c == ' ' || c == '\t' || c == '\r'; }

/* The next word of the line, cut to TOKEN_LENGTH; false at the line's end. A backslash before the line's end continues it. */
static bool next_token(struct walk *w, char token[TOKEN_LENGTH + 1], size_t *length)
{
    for (;;) {
        while (w->at < w->end && blank(*w->at))
            w->at++;
        if (w->end - w->at >= 2 && w->at[0] == '\\' && (w->at[1] == '\n' || w->at[1] == '\r')) {
            w->at += w->end - w->at >= 3 && w->at[1] == '\r' && w->at[2] == '\n' ? 3 : 2;
            w->line++;
            continue;
        }
        break;
    }
    *length = 0;
    while (w->at < w->end && !blank(*w->at) && *w->at != '\n') {
        if (*length < TOKEN_LENGTH)
            token[*length] = (char)*w->at;
        (*length)++;
        w->at++;
    }
    token[*length < TOKEN_LENGTH ? *length : TOKEN_LENGTH] = '\0';
    return *length > 0;
}

static int bad(const struct walk *w, const char *what, const char *token)
{
    return kiln_fail(w->error, KILN_BAD_INPUT, "%.512s: line %llu: %s '%.40s'; repair the file or export it again", w->scene,
                     (unsigned long long)w->line, what, token);
}

static int check_numbers(struct walk *w, int kind)
{
    char token[TOKEN_LENGTH + 1];
    size_t length, count = 0;
    while (next_token(w, token, &length)) {
        char *rest;
        const double value = strtod(token, &rest);
        if (length > TOKEN_LENGTH || *rest != '\0' || !isfinite(value) || fabs(value) > 3e38)
            return bad(w, "not a finite number:", token);
        count++;
    }
    if (count < (kind == 1 ? 1 : 3))
        return bad(w, "too few numbers after", kinds[kind]);
    w->counts[kind]++;
    return KILN_OK;
}

/* "7", "7/1", "7//3", "7/1/3", each index from 1 or, counted back from the last, from -1. */
static int check_corner(struct walk *w, const char *token)
{
    const char *at = token;
    for (int kind = 0; kind < 3; kind++) {
        if (*at != '/' && *at != '\0') {
            char *rest;
            errno = 0;
            const long long index = strtoll(at, &rest, 10);
            const uint64_t size = w->counts[kind];
            if (rest == at || errno != 0 || index == 0 || (index > 0 ? (uint64_t)index > size : (uint64_t)-index > size))
                return kiln_fail(w->error, KILN_BAD_INPUT, "%.512s: line %llu: face corner '%.40s' names %s %.20s of %llu; repair the file or export it again",
                                 w->scene, (unsigned long long)w->line, token, kinds[kind], at, (unsigned long long)size);
            at = rest;
        } else if (kind == 0) {
            return bad(w, "face corner without vertex", token);
        }
        if (*at == '\0')
            return KILN_OK;
        if (*at != '/' || kind == 2)
            return bad(w, "not a face corner:", token);
        at++;
    }
    return KILN_OK;
}

static int check_face(struct walk *w)
{
    char token[TOKEN_LENGTH + 1];
    size_t length, count = 0;
    while (next_token(w, token, &length)) {
        const int status = length > TOKEN_LENGTH ? bad(w, "not a face corner:", token) : check_corner(w, token);
        if (status != KILN_OK)
            return status;
        count++;
    }
    w->faces += count >= 3;
    return KILN_OK;
}

int kiln_obj_check(const char *scene, const unsigned char *text, size_t size, struct kiln_error *error)
{
    struct walk w = {.scene = scene, .at = text, .end = text + size, .line = 1, .error = error};
    while (w.at < w.end) {
        char token[TOKEN_LENGTH + 1];
        size_t length;
        int status = KILN_OK;
        if (next_token(&w, token, &length)) {
            if (strcmp(token, "f") == 0)
                status = check_face(&w);
            for (int kind = 0; kind < 3; kind++)
                if (strcmp(token, kinds[kind]) == 0)
                    status = check_numbers(&w, kind);
        }
        if (status != KILN_OK)
            return status;
        while (w.at < w.end && *w.at != '\n')
            w.at++;
        w.at += w.at < w.end;
        w.line++;
    }
    if (w.faces == 0)
        return kiln_fail(error, KILN_BAD_INPUT, "%.512s: it has no face among its %llu vertices; there is nothing to bake", scene,
                         (unsigned long long)w.counts[0]);
    return KILN_OK;
}
