/* The optional kernel: the inner loops of a tracked frame, for one state and double precision.
 *
 * Each function does what the Python function named above it does; that one explains the method, with its equations,
 * shapes and units, and stays the reference in the tests. Arrays are read and written in place through the buffer
 * protocol. A function that does not treat a case (other shapes or types, several states, a matrix that is singular)
 * returns False, and the caller computes it in Python. No function raises, allocates memory or keeps a state.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

enum { ARRAYS = 80, MOST = 160, MODELS = 4 }; /* MOST: degrees of freedom */

typedef struct { Py_buffer views[ARRAYS]; int count, regular; } Arrays;
typedef double Matrix[MOST][MOST];

/* The numbers of an array of `items` elements of a kind: d double, l int64, f float, ? bool; items < 0: any number. */
static void *any_array(Arrays *a, PyObject *from, const char *kind, Py_ssize_t items, int flags)
{
    Py_buffer *view = &a->views[a->count];
    if (!a->regular || a->count == ARRAYS || PyObject_GetBuffer(from, view, flags | PyBUF_FORMAT) < 0) {
        PyErr_Clear();
        a->regular = 0;
        return NULL;
    }
    a->count++;
    if (!view->format || strcmp(view->format, kind) || (items >= 0 && view->len != items * view->itemsize))
        a->regular = 0;
    return view->buf;
}
static double *in(Arrays *a, PyObject *from, Py_ssize_t items)
{
    return any_array(a, from, "d", items, PyBUF_C_CONTIGUOUS);
}
static double *out(Arrays *a, PyObject *from, Py_ssize_t items)
{
    return any_array(a, from, "d", items, PyBUF_C_CONTIGUOUS | PyBUF_WRITABLE);
}
static int64_t *indices(Arrays *a, PyObject *from, Py_ssize_t least, Py_ssize_t below)
{
    int64_t *found = any_array(a, from, sizeof(long) == 8 ? "l" : "q", -1, PyBUF_C_CONTIGUOUS);
    if (a->regular)
        for (Py_ssize_t i = 0; i < a->views[a->count - 1].len / 8; i++)
            if (found[i] < least || found[i] >= below) a->regular = 0;
    return found;
}
static Py_ssize_t size(const Arrays *a) { return a->regular ? a->views[a->count - 1].len / 8 : 0; }
static PyObject *done(Arrays *a, int regular)
{
    for (int i = 0; i < a->count; i++) PyBuffer_Release(&a->views[i]);
    return PyBool_FromLong(regular);
}
#define FUNCTION(name, arguments)                                                        \
    static PyObject *name(PyObject *Py_UNUSED(self), PyObject *const *o, Py_ssize_t given) \
    {                                                                                    \
        Arrays a = {.count = 0, .regular = given == (arguments)};                        \
        if (!a.regular) return done(&a, 0);
#define IF_REGULAR if (!a.regular) return done(&a, 0);
#define END return done(&a, 1); }

static double dot(const double *restrict x, const double *restrict y, Py_ssize_t n)
{
    double sum = 0;
    for (Py_ssize_t i = 0; i < n; i++) sum += x[i] * y[i];
    return sum;
}
static void cross(const double *x, const double *y, double *result)
{
    result[0] = x[1] * y[2] - x[2] * y[1];
    result[1] = x[2] * y[0] - x[0] * y[2];
    result[2] = x[0] * y[1] - x[1] * y[0];
}
static void product(const double *A, const double *B, double *result) /* 3 x 3 */
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            result[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}
static void turned(const double *A, const double *v, double *result) /* adds A v */
{
    for (int i = 0; i < 3; i++) result[i] += dot(A + 3 * i, v, 3);
}
/* identity I + skew hat(v) + outer v v^T */
static void combined(const double *v, double identity, double skew, double outer, double *result)
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) result[3 * i + j] = outer * v[i] * v[j] + (i == j ? identity : 0);
    result[1] -= skew * v[2], result[2] += skew * v[1], result[3] += skew * v[2];
    result[5] -= skew * v[0], result[6] -= skew * v[1], result[7] += skew * v[0];
}

/* Kinematics.pose: rotations, translation, parents, joints of the landmarks, vectors; orientations, places */
FUNCTION(pose, 7)
    int64_t *parents = indices(&a, o[2], -1, PY_SSIZE_T_MAX);
    Py_ssize_t n = size(&a);
    int64_t *joints = indices(&a, o[3], 0, n);
    Py_ssize_t l = size(&a);
    double *R = in(&a, o[0], 9 * n), *x = in(&a, o[1], 3), *vectors = in(&a, o[4], 3 * (n + l));
    double *turns = out(&a, o[5], 9 * n), *places = out(&a, o[6], 3 * (n + l));
    IF_REGULAR
    for (Py_ssize_t j = 0; j < n; j++) { /* (1)-(2) */
        int64_t above = parents[j];
        if (above >= j) return done(&a, 0);
        if (above < 0) memcpy(turns + 9 * j, R + 9 * j, 9 * sizeof *R);
        else product(turns + 9 * above, R + 9 * j, turns + 9 * j);
        memcpy(places + 3 * j, above < 0 ? x : places + 3 * above, 3 * sizeof *x);
        turned(turns + 9 * (above < 0 ? 0 : above), vectors + 3 * j, places + 3 * j);
    }
    for (Py_ssize_t i = n; i < n + l; i++) {
        int64_t joint = joints[i - n];
        memcpy(places + 3 * i, places + 3 * joint, 3 * sizeof *x);
        turned(turns + 9 * joint, vectors + 3 * i, places + 3 * i);
    }
END

/* BodyState.retract: rotations, omega; result */
FUNCTION(retract, 3)
    double *R = in(&a, o[0], -1), *omega;
    Py_ssize_t n = size(&a) / 9;
    omega = in(&a, o[1], 3 * n);
    double *result = out(&a, o[2], 9 * n), turn[9];
    IF_REGULAR
    for (Py_ssize_t j = 0; j < n; j++) {
        double squared = fmax(dot(omega + 3 * j, omega + 3 * j, 3), 1e-30), t = sqrt(squared), half = sin(0.5 * t) / t;
        combined(omega + 3 * j, cos(t), 2 * half * cos(0.5 * t), 2 * half * half, turn);
        product(R + 9 * j, turn, result + 9 * j);
    }
END

static void live_twists(const double *axes, const double *p, const int64_t *live, Py_ssize_t k, double *result)
{
    for (Py_ssize_t d = 0; d < k; d++) {
        double at[3], *w = result + 6 * d;
        for (int c = 0; c < 3; c++) {
            w[c] = axes[9 * (live[d] / 3) + 3 * c + live[d] % 3];
            at[c] = p[3 * (live[d] / 3) + c] - p[c];
        }
        cross(at, w, w + 3);
    }
}
/* Derivatives of rows f . q at m points q by k twists, with a mask (k, m per); the last 3 rows of columns are f. */
static void spread(const double *twists, Py_ssize_t k, const double *root, const double *q, const double *f,
                   Py_ssize_t rows, Py_ssize_t per, const double *reach, double *columns, Py_ssize_t stride)
{
    for (Py_ssize_t r = 0; r < rows; r++) {
        double at[3], wrench[6];
        for (int c = 0; c < 3; c++) {
            at[c] = q[3 * (r / per) + c] - root[c], wrench[3 + c] = f[3 * r + c];
            columns[(k + c) * stride + r] = f[3 * r + c];
        }
        cross(at, wrench + 3, wrench);
        for (Py_ssize_t d = 0; d < k; d++)
            columns[d * stride + r] = reach[d * rows + r] * dot(twists + 6 * d, wrench, 6);
    }
}

/* What does not change from frame to frame (see evidence/frame_model.py), the state, and what one camera sees. */
typedef struct {
    Py_ssize_t k, root, l, j, r, n, m; /* degrees of freedom (of the root), landmarks, joints and rows of the prior, joints, depths */
    int64_t *live, *prior_live, *depth_joints;
    double *reach, *W, *shares, *arms, *levers, *depth_reach, *constants;
    double *turns, *p, *q, *R, *theta, *residual, *up, height, prior_weight;
    double twists[6 * MOST];
} Body;
typedef struct {
    double *points, *weights, *rotation, *translation, *sight, *depths, *whitening, factor;
    Py_ssize_t row, depth_row;
} View;
enum { NEAREST, THRESHOLD, CAP, LEAN, OFFSET, TAIL, CONSTANTS };

static double number(Arrays *a, PyObject *from)
{
    double found = PyFloat_AsDouble(from);
    if (found == -1 && PyErr_Occurred()) PyErr_Clear(), a->regular = 0;
    return found;
}
static PyObject **items(Arrays *a, PyObject *from, Py_ssize_t count)
{
    if (!PyTuple_Check(from) || PyTuple_GET_SIZE(from) != count) a->regular = 0;
    return a->regular ? ((PyTupleObject *)from)->ob_item : NULL;
}
/* tables: live, landmarks' mask, W, prior's live, shares, lever shares, depth joints, levers, mask, constants;
 * state: orientations, positions, landmarks, rotations, theta, residual, vertical, height, weight of the prior */
static void read_body(Arrays *a, PyObject *tables, PyObject *state, Body *b)
{
    PyObject **t = items(a, tables, 10), **s = items(a, state, 9);
    if (!a->regular) return;
    b->p = in(a, s[1], -1), b->n = size(a) / 3;
    b->q = in(a, s[2], -1), b->l = size(a) / 3;
    b->theta = in(a, s[4], -1), b->j = size(a) / 3;
    b->residual = in(a, s[5], -1), b->r = size(a);
    b->live = indices(a, t[0], 0, 3 * b->n), b->k = size(a);
    b->reach = in(a, t[1], 2 * b->l * b->k), b->W = in(a, t[2], 3 * b->j * b->r);
    b->prior_live = indices(a, t[3], 0, 3 * b->j), b->root = b->k - size(a);
    b->shares = in(a, t[4], b->n), b->arms = in(a, t[5], b->n * b->n);
    b->depth_joints = indices(a, t[6], 0, b->n), b->m = size(a);
    b->levers = in(a, t[7], 3 * b->m), b->depth_reach = in(a, t[8], b->k * b->m), b->constants = in(a, t[9], CONSTANTS);
    b->turns = in(a, s[0], 9 * b->n), b->R = in(a, s[3], 9 * b->n);
    b->up = in(a, s[6], 3), b->height = number(a, s[7]), b->prior_weight = number(a, s[8]);
    if (b->k > MOST || b->l > MOST || b->n > MOST || b->m > MOST || !b->n || b->root < 0) a->regular = 0;
}
/* points, weights, rotation, translation, row; sight, depths, whitening, factor, row, or None five times */
static void read_view(Arrays *a, PyObject *from, const Body *b, View *v)
{
    PyObject **o = items(a, from, 10);
    if (!a->regular) return;
    v->points = in(a, o[0], 2 * b->l), v->weights = in(a, o[1], b->l), v->rotation = in(a, o[2], 9);
    v->translation = in(a, o[3], 3), v->row = (Py_ssize_t)number(a, o[4]), v->sight = NULL;
    if (o[5] == Py_None || b->m < 2) return;
    v->sight = in(a, o[5], 3), v->depths = in(a, o[6], b->m - 1), v->whitening = in(a, o[7], (b->m - 1) * (b->m - 1));
    v->factor = number(a, o[8]), v->depth_row = (Py_ssize_t)number(a, o[9]);
}
/* ImagePoints: place of landmark i in the camera's frame, and its error; returns the error's size over its deviation */
static double image_error(const Body *b, const View *v, Py_ssize_t i, double *place, double *error)
{
    memcpy(place, v->translation, 3 * sizeof *place);
    turned(v->rotation, b->q + 3 * i, place);
    place[2] = fmax(place[2], b->constants[NEAREST]);
    for (int c = 0; c < 2; c++) error[c] = v->points[2 * i + c] - place[c] / place[2];
    return sqrt(error[0] * error[0] + error[1] * error[1]) * v->weights[i];
}
static void image_rows(const Body *b, const View *v, double *columns, Py_ssize_t stride, double *z)
{
    double F[6 * MOST], place[3], error[2];
    for (Py_ssize_t i = 0; i < b->l; i++) { /* (7)-(8) */
        double limit = b->constants[THRESHOLD], off = image_error(b, v, i, place, error);
        double weight = v->weights[i] * sqrt(limit / fmax(off, limit)), across = weight / place[2];
        for (int c = 0; c < 2; c++) {
            for (int e = 0; e < 3; e++)
                F[3 * (2 * i + c) + e] = across * (v->rotation[3 * c + e] - place[c] / place[2] * v->rotation[6 + e]);
            z[2 * i + c] = weight * error[c];
        }
    }
    spread(b->twists, b->k, b->p, b->q, F, 2 * b->l, 2, b->reach, columns, stride);
}
/* PosePrior's columns, of the degrees of freedom after the root's */
static void prior_rows(const Body *b, double *columns, Py_ssize_t stride)
{
    Py_ssize_t k = b->r;
    for (Py_ssize_t d = b->root; d < b->k; d++) {
        Py_ssize_t joint = b->prior_live[d - b->root] / 3, axis = b->prior_live[d - b->root] % 3;
        const double *v = b->theta + 3 * joint, *rows = b->W + 3 * joint * k;
        double squared = fmax(dot(v, v, 3), 1e-30), half = 0.5 * sqrt(squared), cotangent = half / tan(half), J[9];
        combined(v, cotangent, 0.5, (1 - cotangent) / squared, J);
        for (int c = 0; c < 9; c++) J[c] *= b->prior_weight;
        for (Py_ssize_t r = 0; r < k; r++)
            columns[d * stride + r] = J[axis] * rows[r] + J[3 + axis] * rows[k + r] + J[6 + axis] * rows[2 * k + r];
    }
}
/* Upright: R e_y - up */
static double lean(const Body *b, double *found)
{
    for (int c = 0; c < 3; c++) found[c] = b->R[3 * c + 1] - b->up[c];
    return dot(found, found, 3);
}
/* Balance.offset */
static double centre_offset(const Body *b, double *found)
{
    for (int c = 0; c < 3; c++) found[c] = 0;
    for (Py_ssize_t j = 0; j < b->n; j++)
        for (int c = 0; c < 3; c++) found[c] += b->shares[j] * b->p[3 * j + c];
    double vertical = dot(found, b->up, 3);
    for (int c = 0; c < 3; c++) found[c] -= vertical * b->up[c];
    return dot(found, found, 3);
}
static void upright_and_balance_rows(const Body *b, double *upright, double *balance, Py_ssize_t stride, double *z[2])
{
    double away[3], offset[3], lever[3 * MOST], *deviation = b->constants;
    double weight = 1 / sqrt(deviation[LEAN] * deviation[LEAN] + 0.25 * lean(b, away));
    double heavier = 1 / sqrt(deviation[OFFSET] * deviation[OFFSET] + 0.25 * centre_offset(b, offset));
    for (int c = 0; c < 3; c++) z[0][c] = -weight * away[c], z[1][c] = -heavier * offset[c];
    for (Py_ssize_t i = 0; i < 3 * b->n; i++) {
        lever[i] = 0;
        for (Py_ssize_t j = 0; j < b->n; j++) lever[i] += b->arms[b->n * (i / 3) + j] * b->p[3 * j + i % 3];
    }
    for (Py_ssize_t d = 0; d < b->k; d++) {
        double moved[3];
        cross(b->twists + 6 * d, lever + 3 * (b->live[d] / 3), moved);
        double vertical = dot(moved, b->up, 3), sign = b->live[d] == 0 ? weight : b->live[d] == 2 ? -weight : 0;
        for (int c = 0; c < 3; c++) {
            upright[d * stride + c] = sign * b->R[3 * c + 2 - b->live[d] % 3];
            balance[d * stride + c] = heavier * (moved[c] - vertical * b->up[c]);
        }
    }
}
/* LearnedDepth: points of the targets and the right hip, and the whitened errors of their depths */
static void depth_errors(const Body *b, const View *v, double *points, double *whitened)
{
    double depth[MOST];
    for (Py_ssize_t i = 0; i < b->m; i++) {
        double lever[3], *q = points + 3 * i;
        for (int c = 0; c < 3; c++) lever[c] = b->height * b->levers[3 * i + c];
        memcpy(q, b->p + 3 * b->depth_joints[i], 3 * sizeof *q);
        turned(b->turns + 9 * b->depth_joints[i], lever, q);
        depth[i] = dot(q, v->sight, 3);
    }
    double hips = 0.5 * (depth[0] + depth[b->m - 1]);
    for (Py_ssize_t i = 0; i + 1 < b->m; i++) depth[i] = v->depths[i] - (depth[i] - hips);
    for (Py_ssize_t r = 0; r + 1 < b->m; r++) whitened[r] = v->factor * dot(v->whitening + (b->m - 1) * r, depth, b->m - 1);
}
static void depth_rows(const Body *b, const View *v, double *columns, Py_ssize_t stride, double *z)
{
    double points[3 * MOST], weight[MOST], wrench[MOST][6], moved[MOST], tail = b->constants[TAIL];
    Py_ssize_t m = b->m, d = m - 1;
    depth_errors(b, v, points, z);
    for (Py_ssize_t r = 0; r < d; r++) {
        double robust = sqrt((tail + 1) / (tail + z[r] * z[r]));
        z[r] *= robust, weight[r] = robust * v->factor;
    }
    for (Py_ssize_t i = 0; i < m; i++) {
        for (int c = 0; c < 3; c++) points[3 * i + c] -= b->p[c], wrench[i][3 + c] = v->sight[c];
        cross(points + 3 * i, v->sight, wrench[i]);
    }
    for (Py_ssize_t f = 0; f < b->k; f++) {
        for (Py_ssize_t i = 0; i < m; i++) moved[i] = b->depth_reach[f * m + i] * dot(b->twists + 6 * f, wrench[i], 6);
        double middle = 0.5 * (moved[0] + moved[d]);
        for (Py_ssize_t i = 0; i < d; i++) moved[i] -= middle;
        for (Py_ssize_t r = 0; r < d; r++) columns[f * stride + r] = weight[r] * dot(v->whitening + d * r, moved, d);
    }
}

/* FootContact: its tables (ankles, mask, scale), anchors, stiffness, first row */
static void contact_rows(Arrays *a, PyObject *from, const Body *b, double *columns, Py_ssize_t stride, double *z)
{
    PyObject **o = items(a, from, 6);
    if (!a->regular) return;
    int64_t *ankles = indices(a, o[0], 0, b->n);
    if (size(a) != 2) a->regular = 0;
    double *reach = in(a, o[1], 6 * b->k), *anchors = in(a, o[3], 6), *stiffness = in(a, o[4], 2);
    double scale = number(a, o[2]), F[18] = {0}, places[6], error[3];
    Py_ssize_t row = (Py_ssize_t)number(a, o[5]);
    if (row < 0 || row + 6 > stride) a->regular = 0;
    if (!a->regular) return;
    for (int i = 0; i < 2; i++) {
        for (int c = 0; c < 3; c++) {
            places[3 * i + c] = b->p[3 * ankles[i] + c];
            error[c] = stiffness[i] * (anchors[3 * i + c] - places[3 * i + c]);
        }
        double weight = 1 / (1 + dot(error, error, 3) / (scale * scale));
        for (int c = 0; c < 3; c++) z[row + 3 * i + c] = weight * error[c], F[9 * i + 4 * c] = weight * stiffness[i];
    }
    spread(b->twists, b->k, b->p, places, F, 6, 3, reach, columns + row, stride);
}

/* FrameModel.linearise for images, prior, upright, balance, learned depth and feet in contact: tables, state, views,
 * (first rows of prior, upright, balance), feet or None; columns, z */
FUNCTION(linearise, 7)
    Body b;
    View v;
    Py_ssize_t rows[3];
    read_body(&a, o[0], o[1], &b);
    PyObject **begin = items(&a, o[3], 3);
    double *z = out(&a, o[6], -1);
    Py_ssize_t width = size(&a), k = a.regular ? b.r : 0;
    double *columns = out(&a, o[5], a.regular ? (b.k + 3) * width : 0);
    for (int i = 0; a.regular && i < 3; i++) {
        rows[i] = (Py_ssize_t)number(&a, begin[i]);
        if (rows[i] < 0 || rows[i] + (i ? 3 : k) > width) a.regular = 0;
    }
    if (!a.regular || !PyTuple_Check(o[2])) return done(&a, 0);
    double *right[2] = {z + rows[1], z + rows[2]};
    live_twists(b.turns, b.p, b.live, b.k, b.twists);
    for (Py_ssize_t i = 0; i < PyTuple_GET_SIZE(o[2]); i++) {
        read_view(&a, PyTuple_GET_ITEM(o[2], i), &b, &v);
        if (!a.regular || v.row < 0 || v.row + 2 * b.l > width) return done(&a, 0);
        image_rows(&b, &v, columns + v.row, width, z + v.row);
        if (!v.sight) continue;
        if (v.depth_row < 0 || v.depth_row + b.m - 1 > width) return done(&a, 0);
        depth_rows(&b, &v, columns + v.depth_row, width, z + v.depth_row);
        for (int c = 0; c < 3; c++) memset(columns + (b.k + c) * width + v.depth_row, 0, (b.m - 1) * sizeof *z);
    }
    if (o[4] != Py_None) contact_rows(&a, o[4], &b, columns, width, z);
    IF_REGULAR
    prior_rows(&b, columns + rows[0], width);
    for (Py_ssize_t r = 0; r < k; r++) z[rows[0] + r] = b.prior_weight * b.residual[r];
    upright_and_balance_rows(&b, columns + rows[1], columns + rows[2], width, right);
    for (Py_ssize_t d = 0; d < b.k + 3; d++) {
        if (d < b.root || d >= b.k) memset(columns + d * width + rows[0], 0, k * sizeof *z);
        if (d >= b.k) memset(columns + d * width + rows[1], 0, 3 * sizeof *z);
        if (d >= b.k) memset(columns + d * width + rows[2], 0, 3 * sizeof *z);
    }
END

/* FrameModel.cost for the same pieces: tables, state, views; (cost,) */
FUNCTION(cost, 4)
    Body b;
    View v;
    read_body(&a, o[0], o[1], &b);
    double *sum = out(&a, o[3], 1), away[3], place[3], error[2], points[3 * MOST], whitened[MOST];
    if (!a.regular || !PyTuple_Check(o[2])) return done(&a, 0);
    double *limits = b.constants;
    sum[0] = 0.5 * b.prior_weight * b.prior_weight * dot(b.residual, b.residual, b.r);
    sum[0] += 2 * log1p(lean(&b, away) / (4 * limits[LEAN] * limits[LEAN]));
    sum[0] += 2 * log1p(centre_offset(&b, away) / (4 * limits[OFFSET] * limits[OFFSET]));
    for (Py_ssize_t i = 0; i < PyTuple_GET_SIZE(o[2]); i++) {
        read_view(&a, PyTuple_GET_ITEM(o[2], i), &b, &v);
        IF_REGULAR
        for (Py_ssize_t p = 0; p < b.l; p++) {
            double off = fmin(image_error(&b, &v, p, place, error), limits[CAP]), inside = fmin(off, limits[THRESHOLD]);
            sum[0] += inside * (off - 0.5 * inside);
        }
        if (!v.sight) continue;
        depth_errors(&b, &v, points, whitened);
        for (Py_ssize_t r = 0; r + 1 < b.m; r++)
            sum[0] += 0.5 * (limits[TAIL] + 1) * log1p(whitened[r] * whitened[r] / limits[TAIL]);
    }
    if (!isfinite(sum[0])) return done(&a, 0);
END

/* eliminate_translation without H: columns of A, columns of B, z; M A transposed, M z, Y, g */
FUNCTION(eliminate, 7)
    double *z = in(&a, o[2], -1);
    Py_ssize_t m = size(&a);
    double *g = out(&a, o[6], -1);
    Py_ssize_t n = size(&a);
    double *A = in(&a, o[0], n * m), *B = in(&a, o[1], 3 * m), *rows = out(&a, o[3], n * m);
    double *projected = out(&a, o[4], m), *Y = out(&a, o[5], 3 * m);
    IF_REGULAR
    double G[3][3], inverse[3][3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) G[i][j] = dot(B + i * m, B + j * m, m);
    for (int i = 0; i < 3; i++) cross(G[(i + 1) % 3], G[(i + 2) % 3], inverse[i]); /* symmetric: the adjugate */
    double determinant = dot(G[0], inverse[0], 3), mean = (G[0][0] + G[1][1] + G[2][2]) / 3;
    if (!(determinant > 1e-7 * mean * mean * mean)) return done(&a, 0);
    for (int i = 0; i < 3; i++)
        for (Py_ssize_t r = 0; r < m; r++)
            Y[i * m + r] = (inverse[i][0] * B[r] + inverse[i][1] * B[m + r] + inverse[i][2] * B[2 * m + r]) / determinant;
    for (Py_ssize_t i = -1; i < n; i++) {
        const double *from = i < 0 ? z : A + i * m;
        double *to = i < 0 ? projected : rows + i * m, share[3] = {dot(from, Y, m), dot(from, Y + m, m), dot(from, Y + 2 * m, m)};
        for (Py_ssize_t r = 0; r < m; r++) to[r] = from[r] - share[0] * B[r] - share[1] * B[m + r] - share[2] * B[2 * m + r];
        if (i >= 0) g[i] = dot(to, projected, m);
    }
END

/* The factor U of a symmetric matrix U^T U, in place of its upper triangle; 0 if it fails, else min / max of its
 * diagonal. */
static double cholesky(Matrix U, int n)
{
    double least = INFINITY, largest = 0;
    for (int k = 0; k < n; k++) {
        if (!(U[k][k] > 0) || !isfinite(U[k][k])) return 0;
        double root = sqrt(U[k][k]), *restrict row = U[k];
        least = fmin(least, root), largest = fmax(largest, root);
        for (int j = k; j < n; j++) row[j] /= root;
        for (int i = k + 1; i < n; i++) {
            double *restrict other = U[i], factor = row[i];
            for (int j = i; j < n; j++) other[j] -= factor * row[j];
        }
    }
    return n ? least / largest : 1;
}
static void substitute(Matrix U, int n, double *b) /* b <- (U^T U)^-1 b */
{
    for (int i = 0; i < n; i++) {
        b[i] /= U[i][i];
        for (int j = i + 1; j < n; j++) b[j] -= U[i][j] * b[i];
    }
    for (int i = n - 1; i >= 0; i--) b[i] = (b[i] - dot(U[i] + i + 1, b + i + 1, n - i - 1)) / U[i][i];
}

/* predict_solution, then solve_active_set: H, g, alpha, guess, (NEGLIGIBLE, ENTERING_TOGETHER, ALONE_FROM, steps); omega */
FUNCTION(predicted, 6)
    double *g = in(&a, o[1], -1);
    int n = (int)size(&a);
    double *H = in(&a, o[0], (Py_ssize_t)n * n), *alpha = in(&a, o[2], n), *guess = in(&a, o[3], n);
    double *constants = in(&a, o[4], 4), *omega = out(&a, o[5], n);
    IF_REGULAR
    if (n > MOST) return done(&a, 0);
    Matrix U;
    double nearly[MOST], sign[MOST], penalty = 0, largest = 0;
    for (int i = 0; i < n; i++) penalty += alpha[i] * fabs(guess[i]);
    if (!(penalty > 0) || !isfinite(penalty)) return done(&a, 0);
    for (int i = 0; i < n; i++) {
        memcpy(U[i] + i, H + (Py_ssize_t)i * n + i, (n - i) * sizeof *H);
        U[i][i] += alpha[i] / (fabs(guess[i]) + constants[0] * penalty / n / alpha[i]);
        nearly[i] = g[i];
    }
    if (!cholesky(U, n)) return done(&a, 0);
    substitute(U, n, nearly);
    for (int i = 0; i < n; i++) {
        if (fabs(nearly[i]) <= constants[0] * penalty / n / alpha[i]) nearly[i] = 0;
        largest = fmax(largest, fabs(nearly[i]));
    }
    for (int i = 0; i < n; i++) sign[i] = fabs(nearly[i]) < 1e-7 * largest ? 0 : (nearly[i] > 0) - (nearly[i] < 0);
    for (int step = 0; step < (int)constants[3]; step++) {
        int support[MOST], v = 0, contradicted = 0;
        double values[MOST], correlation[MOST], excess[MOST], worst = -INFINITY;
        for (int i = 0; i < n; i++)
            if (sign[i] != 0) support[v++] = i;
        for (int i = 0; i < v; i++) {
            for (int j = i; j < v; j++) U[i][j] = H[(Py_ssize_t)support[i] * n + support[j]];
            values[i] = g[support[i]] - alpha[support[i]] * sign[support[i]];
        }
        if (!(cholesky(U, v) >= 1e-6)) return done(&a, 0);
        substitute(U, v, values);
        memcpy(correlation, g, n * sizeof *g);
        for (int i = 0; i < v; i++)
            for (int k = 0; k < n; k++) correlation[k] -= values[i] * H[(Py_ssize_t)support[i] * n + k];
        for (int k = 0; k < n; k++) excess[k] = fabs(correlation[k]) - alpha[k] * (1 + 1e-10);
        for (int i = 0; i < v; i++) excess[support[i]] = 0;
        for (int k = 0; k < n; k++) worst = fmax(worst, excess[k]);
        for (int i = 0; i < v; i++) contradicted |= values[i] * sign[support[i]] < 0;
        if (!(worst > 0) && !contradicted) {
            memset(omega, 0, n * sizeof *omega);
            for (int i = 0; i < v; i++) omega[support[i]] = values[i];
            return done(&a, 1);
        }
        for (int i = 0; i < v; i++)
            if (values[i] * sign[support[i]] < 0) sign[support[i]] = 0;
        double entering = step < constants[2] ? constants[1] * worst : worst;
        for (int k = 0; k < n; k++)
            if (worst > 0 && excess[k] >= entering) sign[k] = (correlation[k] > 0) - (correlation[k] < 0);
    }
    return done(&a, 0);
}

/* The condensed dual in units of alpha: H, g, alpha, (largest condition,); scaled H^-1, linear term, (norm,) */
FUNCTION(condensed, 7)
    double *g = in(&a, o[1], -1);
    int n = (int)size(&a);
    double *H = in(&a, o[0], (Py_ssize_t)n * n), *alpha = in(&a, o[2], n), *condition = in(&a, o[3], 1);
    double *scaled = out(&a, o[4], (Py_ssize_t)n * n), *linear = out(&a, o[5], n), *norm = out(&a, o[6], 1);
    IF_REGULAR
    if (n > 64 || n < 1) return done(&a, 0); /* of larger matrices LAPACK takes two thirds of the time */
    Matrix U;
    double *V = scaled; /* first the inverse of U */
    for (int i = 0; i < n; i++) memcpy(U[i] + i, H + (Py_ssize_t)i * n + i, (n - i) * sizeof *H);
    double ratio = cholesky(U, n), trace = 0;
    if (!(ratio * ratio * condition[0] >= 1)) return done(&a, 0);
    for (int i = n - 1; i >= 0; i--) {
        double *restrict row = V + i * n;
        memset(row + i, 0, (n - i) * sizeof *row);
        row[i] = 1;
        for (int k = i + 1; k < n; k++)
            for (int j = k; j < n; j++) row[j] -= U[i][k] * V[k * n + j];
        for (int j = i; j < n; j++) row[j] /= U[i][i];
    }
    for (int i = 0; i < n; i++)
        for (int j = i; j < n; j++) U[i][j] = dot(V + i * n + j, V + j * n + j, n - j) * alpha[i] * alpha[j];
    for (int i = 0; i < n; i++) trace += U[i][i];
    norm[0] = trace / n;
    for (int i = 0; i < n; i++)
        for (int j = i; j < n; j++) scaled[i * n + j] = scaled[j * n + i] = U[i][j] / norm[0];
    for (int i = 0; i < n; i++) {
        linear[i] = 0;
        for (int j = 0; j < n; j++) linear[i] -= scaled[i * n + j] * g[j] / alpha[j];
    }
END

/* KeypointFilter.update if no track begins and no point is suspicious: points, weights, squared acceleration factors,
 * (step, stays, switches, noise, largest surprise, variance of unused points, largest distance, longest gap, model error);
 * known, unseen, beliefs, merged, variance, filtered points, filtered weights */
FUNCTION(follow, 11)
    double *weights = in(&a, o[1], -1);
    Py_ssize_t l = size(&a), f = MODELS * l; /* f: from number to number of the beliefs */
    double *points = in(&a, o[0], 2 * l), *squares = in(&a, o[2], MODELS), *constants = in(&a, o[3], 9);
    char *known = any_array(&a, o[4], "?", l, PyBUF_C_CONTIGUOUS | PyBUF_WRITABLE);
    double *unseen = out(&a, o[5], l), *beliefs = out(&a, o[6], 8 * f), *merged = out(&a, o[7], 4 * l);
    double *variance = out(&a, o[8], l), *filtered = out(&a, o[9], 2 * l), *kept = out(&a, o[10], l);
    double ahead[MOST][MODELS][8];
    IF_REGULAR
    double s = constants[0];
    if (l > MOST) return done(&a, 0);
    for (Py_ssize_t i = 0; i < l; i++) { /* KeypointTracks.predict */
        double spread = weights[i] > 0 ? 1 / (weights[i] * weights[i]) : 1, square = 0;
        for (int m = 0; m < MODELS; m++) {
            double *of = ahead[i][m];
            for (int e = 0; e < 8; e++) {
                double *b = beliefs + e * f + i;
                of[e] = constants[2] * (b[0] + b[l] + b[2 * l] + b[3 * l]) + (constants[1] - constants[2]) * b[m * l];
            }
            double q = squares[m] * constants[3] * of[0];
            of[1] += s * of[3], of[2] += s * of[4];
            of[5] += 2 * s * of[6] + s * s * of[7] + q * s * s / 4;
            of[6] += s * of[7] + q * s / 2, of[7] += q;
            spread += 0.5 * of[5];
        }
        for (int c = 0; c < 2; c++) {
            double innovation = points[2 * i + c] - merged[c * l + i] - s * merged[(2 + c) * l + i];
            square += innovation * innovation;
        }
        if (weights[i] > 0 && (!known[i] || !(square / spread <= constants[6]))) return done(&a, 0);
    }
    for (Py_ssize_t i = 0; i < l; i++) { /* KeypointTracks.correct */
        double chance[MODELS], sum = 0, middle[4] = {0, 0, 0, 0};
        int used = weights[i] > 0;
        for (int c = 0; c < 2; c++) merged[c * l + i] += s * merged[(2 + c) * l + i];
        for (int m = 0; m < MODELS; m++) {
            double *row = ahead[i][m], before = row[0];
            for (int e = 1; e < 8; e++) row[e] /= before;
            double pp = row[5] - row[1] * row[1] - row[2] * row[2], pv = row[6] - row[1] * row[3] - row[2] * row[4];
            double vv = row[7] - row[3] * row[3] - row[4] * row[4];
            double own[2] = {points[2 * i] - merged[i] - row[1], points[2 * i + 1] - merged[l + i] - row[2]};
            double spread = pp + (used ? 2 / (weights[i] * weights[i]) : constants[5]);
            double surprise = (own[0] * own[0] + own[1] * own[1]) / spread, gain = pp / spread, faster = pv / spread;
            chance[m] = before * exp(-fmin(surprise, constants[4])) / spread, sum += chance[m];
            for (int c = 0; c < 2; c++) row[1 + c] += gain * own[c], row[3 + c] += faster * own[c];
            row[5] = pp - gain * pp, row[6] = pv - gain * pv, row[7] = vv - faster * pv;
        }
        for (int m = 0; m < MODELS; m++)
            for (int e = 0; e < 4; e++) middle[e] += chance[m] / sum * ahead[i][m][1 + e];
        variance[i] = 0;
        for (int m = 0; m < MODELS; m++) {
            double *row = ahead[i][m], *b = beliefs + m * l + i;
            for (int e = 0; e < 4; e++) row[1 + e] -= middle[e];
            row[5] += row[1] * row[1] + row[2] * row[2], row[6] += row[1] * row[3] + row[2] * row[4];
            row[7] += row[3] * row[3] + row[4] * row[4];
            b[0] = chance[m] / sum, variance[i] += 0.5 * b[0] * row[5];
            for (int e = 1; e < 8; e++) b[e * f] = b[0] * row[e];
        }
        for (int e = 0; e < 4; e++) merged[e * l + i] += middle[e];
        unseen[i] = used ? 0 : unseen[i] + s;
        known[i] = known[i] && unseen[i] < constants[7];
        kept[i] = used || known[i] ? 1 / sqrt(fmax(variance[i], 0) + constants[8] * constants[8]) : 0;
        for (int c = 0; c < 2; c++) filtered[2 * i + c] = merged[c * l + i];
    }
END

/* features: points (overwritten), seen, trunk, gains, vertical, rest of the inputs; inputs, rotation */
FUNCTION(features, 8)
    double *trunk = in(&a, o[2], -1);
    Py_ssize_t k = size(&a);
    double *gains = in(&a, o[3], -1);
    Py_ssize_t values = k * (size(&a) + 1);
    double *points = out(&a, o[0], 2 * values), *up = in(&a, o[4], 3), *rest = in(&a, o[5], -1);
    Py_ssize_t others = size(&a);
    char *seen = any_array(&a, o[1], "?", values, PyBUF_C_CONTIGUOUS);
    float *inputs = any_array(&a, o[6], "f", 3 * values + 4 + others, PyBUF_C_CONTIGUOUS | PyBUF_WRITABLE);
    double *turn = out(&a, o[7], 9), middle[2] = {0, 0}, count = 0, on_trunk = 0, extent = 0;
    IF_REGULAR
    for (Py_ssize_t p = 0; p < k; p++) count += seen[p], on_trunk += seen[p] * trunk[p];
    for (Py_ssize_t p = 0; p < k; p++)
        for (int c = 0; c < 2; c++)
            middle[c] += seen[p] * (on_trunk >= 2 ? trunk[p] / on_trunk : 1 / fmax(count, 1)) * points[2 * p + c];
    double z = 1 / sqrt(1 + middle[0] * middle[0] + middle[1] * middle[1]), x = middle[0] * z, y = middle[1] * z;
    double rotation[9] = {1 - x * x / (1 + z), -x * y / (1 + z), -x, -x * y / (1 + z), 1 - y * y / (1 + z), -y, x, y, z};
    memcpy(turn, rotation, sizeof rotation);
    for (Py_ssize_t p = 0; p < values; p++) {
        double place[3] = {points[2 * p], points[2 * p + 1], 1}, moved[3] = {0, 0, 0};
        turned(rotation, place, moved);
        for (int c = 0; c < 2; c++) points[2 * p + c] = seen[p] ? moved[c] / fmax(moved[2], 0.1) : 0;
        if (p < k) extent += points[2 * p] * points[2 * p] + points[2 * p + 1] * points[2 * p + 1];
        inputs[2 * values + p] = seen[p];
    }
    extent = sqrt(extent / fmax(count, 1)) + 1e-6;
    for (Py_ssize_t p = 0; p < values; p++)
        for (int c = 0; c < 2; c++) {
            double value = points[2 * p + c] / extent;
            if (p >= k) value = gains[p / k - 1] * (value - (seen[p] ? points[2 * (p % k) + c] / extent : 0));
            inputs[2 * p + c] = (float)fmin(fmax(value, -6), 6);
        }
    inputs += 3 * values;
    inputs[0] = (float)(log(extent) + 2);
    for (int c = 0; c < 3; c++) inputs[1 + c] = (float)dot(rotation + 3 * c, up, 3);
    for (Py_ssize_t i = 0; i < others; i++) inputs[4 + i] = (float)rest[i];
END

/* activated, after the bias of the even part is added: even and odd part, changed in place; bias */
FUNCTION(activate, 2)
    float *bias = any_array(&a, o[1], "f", -1, PyBUF_C_CONTIGUOUS);
    Py_ssize_t k = a.regular ? a.views[0].len / 4 : 0;
    float *even = any_array(&a, o[0], "f", 2 * k, PyBUF_C_CONTIGUOUS | PyBUF_WRITABLE), *odd;
    IF_REGULAR
    odd = even + k;
    for (Py_ssize_t i = 0; i < k; i++) {
        float left = even[i] + bias[i] + odd[i], right = even[i] + bias[i] - odd[i];
        left *= 0.5f / (1 + expf(-left)), right *= 0.5f / (1 + expf(-right));
        even[i] = left + right, odd[i] = left - right;
    }
END

#define METHOD(name) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, NULL}
static PyMethodDef methods[] = {
    METHOD(pose), METHOD(retract), METHOD(linearise), METHOD(cost), METHOD(eliminate), METHOD(predicted),
    METHOD(condensed), METHOD(follow), METHOD(features), METHOD(activate), {NULL, NULL, 0, NULL}};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "_kernel", NULL, 0, methods, NULL, NULL, NULL, NULL};
PyMODINIT_FUNC PyInit__kernel(void) { return PyModuleDef_Init(&module); }
