"""PTX (as Taichi's LLVM back end writes it) to C, one function a kernel and thread. Unknown instructions are errors.

Threads of a block meet at barriers, shuffles and votes: there the C code calls `w->meet`, which cuda_stub.c has run each
thread on a stack of its own for (a fiber). Compiled with -DWARP it counts visits of basic blocks, with -DTOUCH it reports accesses to `w->touch`.
"""

# ruff: noqa: E501  (lines of C)

import re
import sys
from pathlib import Path

src = Path(sys.argv[1]).read_text()
src = re.sub(r"//[^\n]*", "", src)
src = re.sub(r"/\*.*?\*/", "", src, flags=re.S)
CT = {
    "pred": "uint8_t",
    "b8": "uint8_t",
    "u8": "uint8_t",
    "s8": "int8_t",
    "b16": "uint16_t",
    "u16": "uint16_t",
    "s16": "int16_t",
    "b32": "uint32_t",
    "u32": "uint32_t",
    "s32": "int32_t",
    "b64": "uint64_t",
    "u64": "uint64_t",
    "s64": "int64_t",
    "f32": "float",
    "f64": "double",
}
SZ = {
    k: {
        "uint8_t": 1,
        "int8_t": 1,
        "uint16_t": 2,
        "int16_t": 2,
        "uint32_t": 4,
        "int32_t": 4,
        "uint64_t": 8,
        "int64_t": 8,
        "float": 4,
        "double": 8,
    }[v]
    for k, v in CT.items()
}
out = []
P = out.append
P("""#include <stdint.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
typedef struct Where Where;
struct Where {
  uint32_t ctaid, tid, nctaid, ntid;
  uint32_t (*meet)(Where *, int op, int site, uint32_t mask, uint32_t value, uint32_t arg, uint32_t clamp, uint8_t *pred);
  void (*touch)(Where *, uint64_t address, int bytes, int kind);
  uint32_t *visits;
};
enum { BAR, BAR_POPC, BAR_AND, BAR_OR, WARP_BAR, BALLOT, ALL, ANY, UNI, IDX, UP, DOWN, BFLY, MATCH_ANY, MATCH_ALL };
#ifdef WARP
#define VISIT(n) w->visits[n]++;
#else
#define VISIT(n)
#endif
#define B2F(x) ({ uint32_t v_ = (x); float f_; memcpy(&f_, &v_, 4); f_; })
#define B2D(x) ({ uint64_t v_ = (x); double f_; memcpy(&f_, &v_, 8); f_; })
#define F2B(x) ({ float v_ = (x); uint32_t f_; memcpy(&f_, &v_, 4); f_; })
#define D2B(x) ({ double v_ = (x); uint64_t f_; memcpy(&f_, &v_, 8); f_; })
#ifdef TOUCH  // kind: 0 load, 1 store, 2 atomic; 4 more of shared memory
#define LD(T, a, s) (*({ uint64_t p_ = (uint64_t)(a); w->touch(w, p_, sizeof(T), s); (volatile T *)p_; }))
#define ST(T, a, s) (*({ uint64_t p_ = (uint64_t)(a); w->touch(w, p_, sizeof(T), s + 1); (volatile T *)p_; }))
#define AT(p, s) ({ __typeof__(p) q_ = (p); w->touch(w, (uint64_t)q_, sizeof(*q_), s + 2); q_; })
#else
#define LD(T, a, s) (*(volatile T *)(uint64_t)(a))
#define ST(T, a, s) LD(T, a, s)
#define AT(p, s) p
#endif
static int64_t d2i(double x, double lo, double hi) { return isnan(x) ? 0 : x <= lo ? (int64_t)lo : x >= hi ? (hi > 9e18 ? INT64_MAX : (int64_t)hi) : (int64_t)x; }
static void F_vprintf(void *ret, void **a, Where *w) { fprintf(stderr, "vprintf: %s\\n", *(char **)a[0]); *(int *)ret = 0; }
static void F___assertfail(void *ret, void **a, Where *w) { fprintf(stderr, "assertfail: %s\\n", *(char **)a[0]); abort(); }
static void F_malloc(void *ret, void **a, Where *w) { *(void **)ret = malloc(*(uint64_t *)a[0]); }
static void F_free(void *ret, void **a, Where *w) { free(*(void **)a[0]); }
typedef void (*FP)(void *, void **, Where *);
""")


def err(s):
    raise SystemExit("ptx2c: cannot translate: " + s)


def cname(n):
    return n.replace(".", "_dot_").replace("%", "r_")


class Ctx:
    pass


def operand(o, t, c):
    """C expression of type CT[t]"""
    o = o.strip()
    T = CT[t]
    m = re.fullmatch(r"0[dD]([0-9A-Fa-f]{16})", o)
    if m:
        return f"B2D(0x{m[1]}ull)" if t == "f64" else f"((({T})0x{m[1]}ull))"
    m = re.fullmatch(r"0[fF]([0-9A-Fa-f]{8})", o)
    if m:
        return f"B2F(0x{m[1]}u)" if t == "f32" else f"(({T})0x{m[1]}u)"
    if re.fullmatch(r"-?\d+", o):
        if t in ("f32", "f64"):
            err("int imm in float " + o)
        v = int(o)
        return f"(({T}){v & (2**64 - 1)}ull)"
    if re.fullmatch(r"-?0x[0-9a-fA-F]+", o):
        return f"(({T}){o}ull)"
    if o in ("%tid.x", "%ntid.x", "%ctaid.x", "%nctaid.x"):
        return {"%tid.x": "w->tid", "%ntid.x": "w->ntid", "%ctaid.x": "w->ctaid", "%nctaid.x": "w->nctaid"}[o]
    if o in ("%tid.y", "%tid.z", "%ctaid.y", "%ctaid.z"):
        return "0u"
    if o in ("%laneid",):
        return "(w->tid & 31)"
    if o == "WARP_SZ":
        return "32u"
    if o == "%clock64":
        return "0ull"
    if o.startswith("%") or o in c.regs:
        rt = c.regs.get(o)
        if rt is None:
            err("unknown register " + o)
        n = cname(o)
        if rt == "pred":
            return n
        if (rt in ("f32", "f64")) == (t in ("f32", "f64")):
            if rt in ("f32", "f64"):
                if rt != t:
                    err(f"{o} is {rt} used as {t}")
                return n
            return f"(({T}){n})"
        if rt == "f64":
            return f"(({T})D2B({n}))"
        if rt == "f32":
            return f"(({T})F2B({n}))"
        return f"B2D({n})" if t == "f64" else f"B2F({n})"
    if o in c.params:
        return f"((uint64_t)args[{c.params[o]}])"
    if o in c.locals:
        return f"((uint64_t){cname(o)})"
    if o in c.callbuf:
        return f"((uint64_t){cname(o)})"
    if o in globals_:
        return f"((uint64_t)G_{cname(o)})"
    if o in funcs:
        return f"((uint64_t)(void *)F_{cname(o)})"
    m = re.fullmatch(r"([A-Za-z_$][\w$]*)\+(\d+)", o)
    if m:
        return f"({operand(m[1], t, c)} + {m[2]})"
    err("operand " + o)


def setreg(d, t, e, c):
    """assign expression e of type t to register d"""
    d = d.strip()
    if d == "_":  # thrown away
        return ""
    rt = c.regs.get(d)
    if rt is None:
        err("dest " + d)
    n = cname(d)
    if rt == "pred":
        return f"{n} = {e};"
    fl = rt in ("f32", "f64")
    tf = t in ("f32", "f64")
    if fl == tf:
        if fl and rt != t:
            err(f"dest {d} {rt} {t}")
        if not fl:
            # sign- or zero-extend as the instruction's type says
            return f"{n} = ({CT[rt]})({CT[t]})({e});"
        return f"{n} = {e};"
    if rt == "f64":
        return f"{n} = B2D({e});"
    if rt == "f32":
        return f"{n} = B2F({e});"
    return f"{n} = {'D2B' if t == 'f64' else 'F2B'}({e});"


def addr(a, c):
    a = a.strip()[1:-1].strip()
    m = re.fullmatch(r"(.+?)\s*\+\s*(-?\d+)", a)
    if m:
        return f"({operand(m[1], 'u64', c)} + ({m[2]}ll))"
    return operand(a, "u64", c)


def split_ops(s):
    parts, depth, cur = [], 0, ""
    for ch in s:
        if ch in "{[(":
            depth += 1
        if ch in "}])":
            depth -= 1
        if ch == "," and depth == 0:
            parts.append(cur.strip())
            cur = ""
        else:
            cur += ch
    if cur.strip():
        parts.append(cur.strip())
    return parts


CMP = {
    "eq": "==",
    "ne": "!=",
    "lt": "<",
    "le": "<=",
    "gt": ">",
    "ge": ">=",
    "lo": "<",
    "ls": "<=",
    "hi": ">",
    "hs": ">=",
}

CALLS = {
    "fma": ("fma", 1, 2, 3),
    "sqrt": ("sqrt", 1),
    "lg2": ("log2", 1),
    "ex2": ("exp2", 1),
    "sin": ("sin", 1),
    "cos": ("cos", 1),
    "abs": ("fabs", 1),
    "copysign": ("copysign", 2, 1),
    "min": ("fmin", 1, 2),
    "max": ("fmax", 1, 2),
}
"""Instructions on floating-point numbers that are a function of C, and their operands."""


def compare(cmp, a, b, t):
    if t in ("f32", "f64"):
        if cmp in CMP and cmp != "ne":
            return f"({a} {CMP[cmp]} {b})"
        if cmp == "ne":
            return f"(({a} < {b}) || ({a} > {b}))"
        if cmp == "nan":
            return f"(isnan({a}) || isnan({b}))"
        if cmp == "num":
            return f"!(isnan({a}) || isnan({b}))"
        if cmp.endswith("u") and cmp[:-1] in CMP:
            neg = {
                "equ": f"!(({a} < {b}) || ({a} > {b}))",
                "neu": f"!({a} == {b})",
                "ltu": f"!({a} >= {b})",
                "leu": f"!({a} > {b})",
                "gtu": f"!({a} <= {b})",
                "geu": f"!({a} < {b})",
            }
            return neg[cmp]
        err("cmp " + cmp)
    return f"({a} {CMP[cmp]} {b})"


def instr(s, c):
    s = s.strip()
    pre = ""
    m = re.match(r"@(!?)(%\w+)\s+(.*)", s, re.S)
    if m:
        pre = f"if ({'!' if m[1] else ''}{cname(m[2])}) "
        s = m[3]
    m = re.match(r"([\w.:]+)\s*(.*)", s, re.S)
    op, rest = m[1], m[2].strip()
    f = op.split(".")
    o = f[0]
    ops = split_ops(rest)
    t = f[-1]
    space = 4 if "shared" in f else 0

    def A(i, ty=None):
        return operand(ops[i], ty or t, c)

    def S(e, ty=None):
        return pre + "{ " + setreg(ops[0], ty or t, e, c) + " }"

    if o == "bra":
        return pre + f"goto {ops[0].replace('$', 'D')};"
    if o == "brx":
        cases = " ".join(f"case {k}: goto {each};" for k, each in enumerate(c.targets[ops[1]]))
        return pre + f"switch ({A(0, 'u32')}) {{ {cases} default: abort(); }}"
    if o in ("ret", "exit"):
        return pre + "return;"
    if o == "trap":
        return pre + "abort();"
    if o in ("membar", "fence"):
        return pre + "__sync_synchronize();"
    if o in ("bar", "barrier"):
        c.meets = True
        c.sites[0] += 1
        if "warp" in f:
            return (
                pre
                + f"w->meet(w, WARP_BAR, {c.sites[0]}, (uint32_t){operand(ops[0], 'u32', c)}, 0, 0, 0, 0);"
            )
        kind = (
            "BAR"
            if "sync" in f
            else {"popc": "BAR_POPC", "and": "BAR_AND", "or": "BAR_OR"}.get(f[2] if f[1] == "red" else "")
        )
        if kind is None or (ops[0] if kind == "BAR" else ops[1]) != "0" or (kind == "BAR" and len(ops) > 1):
            err(s)
        if kind == "BAR":
            return pre + f"w->meet(w, BAR, {c.sites[0]}, 0, 0, 0, 0, 0);"
        e = f"w->meet(w, {kind}, {c.sites[0]}, 0, {'!' if ops[2].startswith('!') else ''}{cname(ops[2].lstrip('!'))}, 0, 0, 0)"
        return pre + (f"{cname(ops[0])} = {e};" if t == "pred" else "{ " + setreg(ops[0], "u32", e, c) + " }")
    if o in ("shfl", "vote", "match"):
        if f[1] != "sync" and not (o == "match" and f[2] == "sync"):
            err(s + " (without .sync)")
        c.meets = True
        c.sites[0] += 1
        k = c.sites[0]
        if o == "vote":
            kind = {"ballot": "BALLOT", "all": "ALL", "any": "ANY", "uni": "UNI"}[f[2]]
            q = ("!" if ops[1].startswith("!") else "") + cname(ops[1].lstrip("!"))
            if ops[1] in ("0", "1", "-1"):
                q = "0" if ops[1] == "0" else "1"
            e = f"w->meet(w, {kind}, {k}, {operand(ops[2], 'u32', c)}, {q}, 0, 0, 0)"
            return pre + (
                f"{cname(ops[0])} = {e};" if t == "pred" else "{ " + setreg(ops[0], "b32", e, c) + " }"
            )
        d, _, q = ops[0].partition("|")
        got = f"&{cname(q)}" if q else "0"
        if o == "match":
            if t != "b32":
                err(s)
            e = f"w->meet(w, {'MATCH_ANY' if f[1] == 'any' else 'MATCH_ALL'}, {k}, {operand(ops[2], 'u32', c)}, {A(1)}, 0, 0, {got})"
        else:
            kind = {"idx": "IDX", "up": "UP", "down": "DOWN", "bfly": "BFLY"}[f[2]]
            e = f"w->meet(w, {kind}, {k}, {operand(ops[4], 'u32', c)}, {A(1)}, {operand(ops[2], 'u32', c)}, {operand(ops[3], 'u32', c)}, {got})"
        return pre + "{ " + setreg(d, "b32", e, c) + " }"
    if o == "mov":
        if ops[1].startswith("{"):
            parts = split_ops(ops[1][1:-1])
            n = len(parts)
            half = {2: {64: 32, 32: 16}[int(t[1:])], 4: 16}[n]
            bits = f"b{half}"
            e = " | ".join(f"((uint64_t){operand(p, bits, c)} << {half * i})" for i, p in enumerate(parts))
            return S(f"({e})", t)
        if ops[0].startswith("{"):
            parts = split_ops(ops[0][1:-1])
            n = len(parts)
            half = {2: {64: 32, 32: 16}[int(t[1:])], 4: 16}[n]
            bits = f"b{half}"
            return (
                pre
                + f"{{ uint64_t t_ = {A(1)}; "
                + " ".join(setreg(p, bits, f"(t_ >> {half * i})", c) for i, p in enumerate(parts))
                + " }"
            )
        if t == "pred":
            return (
                pre
                + f"{cname(ops[0])} = {1 if ops[1] == '-1' or ops[1] == '1' else 0 if ops[1] == '0' else cname(ops[1])};"
            )
        return S(A(1))
    if o in ("ld", "ldu"):
        v = [x for x in f if re.fullmatch(r"v\d", x)]
        if v:
            regs = split_ops(ops[0][1:-1])
            return (
                pre
                + f"{{ uint64_t a_ = {addr(ops[1], c)}; "
                + " ".join(
                    setreg(r, t, f"LD({CT[t]}, a_ + {SZ[t] * i}, {space})", c) for i, r in enumerate(regs)
                )
                + " }"
            )
        return S(f"LD({CT[t]}, {addr(ops[1], c)}, {space})")
    if o == "st":
        v = [x for x in f if re.fullmatch(r"v\d", x)]
        if v:
            regs = split_ops(ops[1][1:-1])
            return (
                pre
                + f"{{ uint64_t a_ = {addr(ops[0], c)}; "
                + " ".join(
                    f"ST({CT[t]}, a_ + {SZ[t] * i}, {space}) = {operand(r, t, c)};"
                    for i, r in enumerate(regs)
                )
                + " }"
            )
        return pre + f"ST({CT[t]}, {addr(ops[0], c)}, {space}) = {A(1)};"
    if o == "cvta":
        return S(A(1, "u64"), "u64")
    if o in ("atom", "red"):
        k = next(x for x in f if x in ("add", "min", "max", "exch", "cas", "and", "or", "xor", "inc"))
        T = CT[t]
        dest = ops[0] if o == "atom" else None
        a = ops[1:] if o == "atom" else ops
        ad = addr(a[0], c)
        v = operand(a[1], t, c)
        n = SZ[t] * 8
        word = f"uint{n}_t"
        p = "x_"
        pre_at = f"{word} *x_ = AT(({word} *)({ad}), {space}); "
        tobits = {"f64": "D2B", "f32": "F2B"}.get(t, f"({word})")
        frombits = {"f64": "B2D", "f32": "B2F"}.get(t, f"({T})")
        if k == "cas":
            e = f"{word} old_ = {tobits}({v}); __atomic_compare_exchange_n({p}, &old_, {tobits}({operand(a[2], t, c)}), 0, 5, 5);"
        elif k == "exch":
            e = f"{word} old_ = __atomic_exchange_n({p}, {tobits}({v}), 5);"
        else:
            new = {
                "add": f"(o_ + {v})",
                "min": f"({v} < o_ ? {v} : o_)",
                "max": f"({v} > o_ ? {v} : o_)",
                "and": f"(o_ & {v})",
                "or": f"(o_ | {v})",
                "xor": f"(o_ ^ {v})",
            }[k]
            e = f"{word} old_ = *(volatile {word} *){p}; for (;;) {{ {T} o_ = {frombits}(old_); {word} n_ = {tobits}(({T}){new}); if (__atomic_compare_exchange_n({p}, &old_, n_, 0, 5, 5)) break; }}"
        return (
            pre
            + "{ "
            + pre_at
            + e
            + (" " + setreg(dest, t, f"{frombits}(old_)", c) if dest and dest != "_" else "")
            + " }"
        )
    if o == "setp":
        cmp = f[1]
        e = compare(cmp, A(1), A(2), t)
        if len(f) > 3 and f[2] in ("and", "or", "xor"):
            neg = ops[3].startswith("!")
            q = cname(ops[3].lstrip("!"))
            e = f"({e} {dict(zip(('and', 'or', 'xor'), ('&&', '||', '!='), strict=False))[f[2]]} {'!' if neg else ''}{q})"
        return pre + f"{cname(ops[0])} = {e};"
    if o == "selp":
        return S(f"({cname(ops[3])} ? {A(1)} : {A(2)})")
    if o == "slct":
        err(op)
    if o in ("and", "or", "xor"):
        sy = {"and": "&", "or": "|", "xor": "^"}[o]
        if t == "pred":
            return (
                pre
                + f"{cname(ops[0])} = {cname(ops[1])} {sy} {cname(ops[2]) if ops[2].startswith('%') else ops[2]};"
            )
        return S(f"({A(1)} {sy} {A(2)})")
    if o == "not":
        if t == "pred":
            return pre + f"{cname(ops[0])} = !{cname(ops[1])};"
        return S(f"(~{A(1)})")
    if o in ("shl", "shr"):
        n = SZ[t] * 8
        if o == "shl":
            return S(f"({{ uint32_t s_ = {A(2, 'u32')}; s_ >= {n} ? 0 : ({CT['u' + t[1:]]}){A(1)} << s_; }})")
        if t[0] == "s":
            return S(f"({{ uint32_t s_ = {A(2, 'u32')}; {A(1)} >> (s_ >= {n} ? {n - 1} : s_); }})")
        return S(f"({{ uint32_t s_ = {A(2, 'u32')}; s_ >= {n} ? 0 : {A(1, 'u' + t[1:])} >> s_; }})")
    if o == "shf":
        if f[1] == "l":
            return S(
                f"({{ uint32_t s_ = {A(3, 'u32')}; uint64_t v_ = ((uint64_t){A(2)} << 32) | {A(1)}; s_ = \"{f[2]}\"[0] == 'w' ? s_ & 31 : (s_ > 32 ? 32 : s_); (uint32_t)((v_ << s_) >> 32); }})"
            )
        return S(
            f"({{ uint32_t s_ = {A(3, 'u32')}; uint64_t v_ = ((uint64_t){A(2)} << 32) | {A(1)}; s_ = \"{f[2]}\"[0] == 'w' ? s_ & 31 : (s_ > 32 ? 32 : s_); (uint32_t)(v_ >> s_); }})"
        )
    if (o in ("add", "addc", "mad", "madc", "sub", "subc") and "cc" in f) or o in ("addc", "madc", "subc"):
        n = SZ[t] * 8
        T = f"uint{n}_t"
        W = "uint64_t" if n == 32 else "unsigned __int128"
        cin = "+ cc_" if o.endswith("c") else ""
        if o.startswith("mad"):
            prod = f"({W})({T})(({W}){A(1)} * ({W}){A(2)}" + (f" >> {n})" if "hi" in f else ")")
            e = f"{prod} + ({W}){A(3)} {cin}"
        elif o.startswith("add"):
            e = f"({W}){A(1)} + ({W}){A(2)} {cin}"
        else:
            e = f"({W}){A(1)} - ({W}){A(2)} {'- cc_' if o == 'subc' else ''}"
        c.carry = True
        return (
            pre
            + f"{{ {W} w_ = {e}; "
            + (f"cc_ = (uint32_t)(w_ >> {n}) & 1; " if "cc" in f else "")
            + setreg(ops[0], t, f"({T})w_", c)
            + " }"
        )
    if o in ("add", "sub"):
        sy = "+" if o == "add" else "-"
        u = t if t[0] == "f" else "u" + t[1:]
        return S(f"({A(1, u)} {sy} {A(2, u)})", u)
    if o == "mul":
        if t[0] == "f":
            return S(f"({A(1)} * {A(2)})")
        if f[1] == "lo":
            u = "u" + t[1:]
            return S(f"({CT[u]})((uint64_t){A(1, u)} * (uint64_t){A(2, u)})", u)
        if f[1] == "wide":
            wt = t[0] + str(2 * int(t[1:]))
            return S(f"(({CT[wt]}){A(1)} * ({CT[wt]}){A(2)})", wt)
        if f[1] == "hi":
            huge = "unsigned __int128" if t[0] == "u" else "__int128"
            big = huge if SZ[t] == 8 else CT[f"{t[0]}{16 * SZ[t]}"]
            return S(f"({CT[t]})((({big}){A(1)} * ({big}){A(2)}) >> {SZ[t] * 8})")
    if o == "mad":
        if f[1] == "lo":
            u = "u" + t[1:]
            return S(f"({A(1, u)} * {A(2, u)} + {A(3, u)})", u)
        if f[1] == "wide":
            wt = t[0] + str(2 * int(t[1:]))
            return S(f"(({CT[wt]}){A(1)} * ({CT[wt]}){A(2)} + {operand(ops[3], wt, c)})", wt)
    if t[0] == "f" and o in CALLS:
        name, *arguments = CALLS[o]
        return S(f"{name}{'f' if t == 'f32' else ''}({', '.join(A(i) for i in arguments)})")
    if o == "div":
        if t[0] == "f":
            return S(f"({A(1)} / {A(2)})")
        return S(f"({{ {CT[t]} d_ = {A(2)}; d_ == 0 ? ({CT[t]})-1 : {A(1)} / d_; }})")
    if o == "rem":
        return S(f"({{ {CT[t]} d_ = {A(2)}; d_ == 0 ? {A(1)} : {A(1)} % d_; }})")
    if o == "rcp":
        return S(f"(1.0{'f' if t == 'f32' else ''} / {A(1)})")
    if o == "rsqrt":
        return S(f"(1.0 / sqrt({A(1)}))")
    if o == "neg":
        return S(f"(-{A(1)})")
    if o == "abs":
        return S(f"({A(1)} < 0 ? -{A(1)} : {A(1)})")
    if o in ("min", "max"):
        return S(f"({A(1)} {'<' if o == 'min' else '>'} {A(2)} ? {A(1)} : {A(2)})")
    if o == "popc":
        return S(f"__builtin_popcountll({A(1)})", "u32")
    if o == "clz":
        return S(f"({A(1)} ? __builtin_clz{'ll' if t == 'b64' else ''}({A(1)}) : {SZ[t] * 8})", "u32")
    if o == "bfe":
        return S(
            f"({{ uint32_t p_ = {A(2, 'u32')} & 255, l_ = {A(3, 'u32')} & 255; l_ == 0 ? 0 : "
            + (
                f"(int64_t)((uint64_t)(int64_t){A(1)} >> p_ << (64 - l_)) >> (64 - l_)"
                if t[0] == "s"
                else f"((uint64_t){A(1)} >> p_) & (l_ >= 64 ? ~0ull : (1ull << l_) - 1)"
            )
            + "; })"
        )
    if o == "bfi":
        return S(
            f"({{ uint64_t a_ = {A(1)}, b_ = {A(2)}; uint32_t p_ = {A(3, 'u32')}, l_ = {A(4, 'u32')}; uint64_t m_ = (l_ >= 64 ? ~0ull : ((1ull << l_) - 1)) << p_; (b_ & ~m_) | ((a_ << p_) & m_); }})"
        )
    if o == "testp":
        return (
            pre
            + f"{cname(ops[0])} = { {'finite': 'isfinite', 'infinite': 'isinf', 'number': '!isnan', 'notanumber': 'isnan'}[f[1]] }({A(1)});"
        )
    if o == "activemask":
        return S("(1u << (w->tid & 31))")  # a thread knows of itself only
    if o == "cvt":
        st, dt = f[-1], f[-2]
        mods = f[1:-2]
        a = operand(ops[1], st, c)
        df, sf = dt[0] == "f", st[0] == "f"
        if sf and df:
            r = {"rmi": "floor", "rpi": "ceil", "rni": "rint", "rzi": "trunc"}
            for m_ in mods:
                if m_ in r:
                    a = f"{r[m_]}{'f' if st == 'f32' else ''}({a})"
            if "sat" in mods:
                a = f"fmin(fmax({a}, 0.0), 1.0)"
            return S(f"(({CT[dt]}){a})", dt)
        if df:
            return S(f"(({CT[dt]}){a})", dt)
        if sf:
            r = {"rmi": "floor", "rpi": "ceil", "rni": "rint", "rzi": "trunc"}
            g = next(m_ for m_ in mods if m_ in r)
            lim = {
                "s32": ("-2147483648.0", "2147483647.0"),
                "u32": ("0.0", "4294967295.0"),
                "s64": ("-9223372036854775808.0", "9223372036854775808.0"),
                "u64": ("0.0", "9223372036854775808.0"),
                "s16": ("-32768.0", "32767.0"),
            }[dt]
            return S(f"({CT[dt]})d2i({r[g]}((double){a}), {lim[0]}, {lim[1]})", dt)
        return S(f"(({CT[dt]}){a})", dt)
    err(s)


# top level: globals and functions
globals_, funcs = {}, {}
for m in re.finditer(
    r"^\.(?:visible\s+|weak\s+|extern\s+)*\.?(?:global|const)\s+(?:\.align\s+\d+\s+)?\.(\w+)\s+([\w$]+)(?:\[(\d*)\])?(?:\s*=\s*([^;]+))?;",
    src,
    re.M,
):
    globals_[m[2]] = (m[1], int(m[3] or 1), m[4])
for n, (ty, k, init) in globals_.items():
    if init and re.search(r"[A-Za-z_$]", re.sub(r"0[xdfXDF][0-9A-Fa-f]+", "", init)):
        err("global initialiser " + n + init)
    P(
        f"static {CT[ty]} G_{cname(n)}[{k}] __attribute__((aligned(16))){' = ' + (init if init.strip().startswith('{') else '{' + init + '}') if init else ''};"
    )
shared_ = {}
for m in re.finditer(
    r"^\.(?:visible\s+|weak\s+|extern\s+)*\.?shared\s+(?:\.align\s+\d+\s+)?\.(\w+)\s+([\w$]+)\[(\d*)\];",
    src,
    re.M,
):
    if not m[3]:
        err(
            f"{m[2]}: a shared array of more than 48 KiB. Taichi 1.7.4 declares it without a size and launches with 0 bytes for it: on a GPU it would lie outside of the block's shared memory"
        )
    globals_[m[2]] = (m[1], int(m[3]), None)
    shared_[m[2]] = int(m[3]) * SZ[m[1]]
    P(f"static __thread {CT[m[1]]} G_{cname(m[2])}[{m[3]}] __attribute__((aligned(16)));")
P(
    "void M_poison(void) {"
    + "".join(f" memset(G_{cname(n)}, 0xA5, sizeof G_{cname(n)});" for n in shared_)
    + " }"
)
fre = re.compile(
    r"^((?:\.(?:visible|extern|weak)\s+)*)\.(entry|func)\s*(\([^)]*\))?\s*([\w$]+)\s*\(([^)]*)\)\s*((?:\.\w+[^\n{;]*\n?)*)\s*([{;])",
    re.M,
)
found = []
for m in fre.finditer(src):
    ext = m[7] == ";"
    funcs[m[4]] = m
    body = None
    if not ext:
        d, i = 1, m.end()
        while d:
            if src[i] == "{":
                d += 1
            elif src[i] == "}":
                d -= 1
            i += 1
        body = src[m.end() : i - 1]
    found.append((m[2], m[3], m[4], m[5], body))
defined = {n for _, _, n, _, b in found if b is not None}
found = [x for x in found if x[4] is not None or x[2] not in defined]
for _, _, name, _, body in found:
    if body is not None:
        P(f"static void F_{cname(name)}(void *ret, void **args, Where *w);")
    elif name not in ("vprintf", "__assertfail", "malloc", "free"):
        P(
            f'static void F_{cname(name)}(void *ret, void **args, Where *w) {{ fprintf(stderr, "extern {name}\\n"); abort(); }}'
        )


def pname(p):
    return re.search(r"([\w$]+)(\[\d*\])?\s*$", p.strip())[1]


calls = {n: set(re.findall(r"[\w$]+", b)) & set(funcs) for _, _, n, _, b in found if b is not None}
bodies = {n: b for _, _, n, _, b in found if b is not None}


def reach(n):
    found_so_far, todo = set(), [n]
    while todo:
        n = todo.pop()
        if n not in found_so_far:
            found_so_far.add(n)
            todo += calls.get(n, ())
    return found_so_far


MEETS = re.compile(r"\b(?:bar|barrier|shfl|vote|match)\.")
sites, block_rows, block_code, n_blocks = [0], [], [], 0
CLASSES = ("int", "f64", "div", "lds", "sts", "ldg", "stg", "atoms", "atomg", "meet", "branch")
# Cycles until what an instruction gives can be used (H100; loads hit the L1), and of loads that only the L2 has.
CYCLES = dict(zip(CLASSES, (5, 9, 160, 29, 4, 36, 4, 60, 300, 26, 10), strict=True))
FROM_L2 = 250


def class_of(s):
    s = re.sub(r"^@!?%\w+\s+", "", s.strip())
    op = s.split()[0] if s.split() else ""
    f = op.split(".")
    if f[0] in ("bar", "barrier", "shfl", "vote", "match"):
        return "meet"
    if f[0] in ("bra", "ret", "exit", "call"):
        return "branch"
    if f[0] in ("div", "sqrt", "rcp", "rsqrt", "rem") and f[-1] in ("f64", "s64", "u64", "s32", "u32"):
        return "div"
    if f[0] in ("atom", "red"):
        return "atoms" if "shared" in f else "atomg"
    if f[0] in ("ld", "ldu"):
        return None if "param" in f else "lds" if "shared" in f else "ldg"
    if f[0] == "st":
        return None if "param" in f else "sts" if "shared" in f else "stg"
    if f[0] in ("mov", "cvta"):
        return None  # most go away in ptxas
    if "f64" in f:
        return "f64"
    return "int"


def overlapped(code):
    """Cycles of a basic block whose instructions wait only for their operands, and loads for earlier stores to begin.

    A store may write what a later load reads, so no compiler exchanges them.
    """
    ready, stored, end = {}, 0, 0
    for s in code:
        k = class_of(s)
        m = re.match(r"(?:@!?(%\w+)\s+)?(\S+)\s*(.*)", s, re.S)
        operands = split_ops(m[3])
        given = k in ("sts", "stg", "branch") or m[2].split(".")[0] == "red" or not operands
        results = [] if given else re.findall(r"%\w+", operands[0])
        needed = re.findall(r"%\w+", " ".join(operands[0 if given else 1 :])) + ([m[1]] if m[1] else [])
        begin = max((ready.get(r, 0) for r in needed), default=0)
        if k in ("lds", "ldg", "atoms", "atomg", "meet"):
            begin = max(begin, stored)
        if k in ("meet", "branch"):
            begin = max(begin, end)
        if k in ("sts", "stg", "atoms", "atomg", "meet"):
            stored = max(stored, begin)
        done = begin + (0 if k is None else FROM_L2 if k == "ldg" else CYCLES[k])
        ready.update(dict.fromkeys(results, done))
        end = max(end, done)
    return end


def begin_block():
    global n_blocks
    block_rows.append(dict.fromkeys(CLASSES, 0))
    block_code.append([])
    n_blocks += 1
    return f"VISIT({n_blocks - 1})"


for kind, ret, name, params, body in found:
    if body is None:
        continue
    if kind == "entry":
        total = sum(
            size
            for n, size in shared_.items()
            if any(re.search(r"\b" + re.escape(n) + r"\b", bodies.get(g, "")) for g in reach(name))
        )
        if total > 49152:
            err(f"{name}: {total} bytes of shared arrays; Taichi can have 49152")
    c = Ctx()
    c.sites, c.meets, c.scopes, c.targets = sites, False, [], {}
    c.regs, c.locals, c.callbuf = {}, {}, {}
    c.params = {pname(p): i for i, p in enumerate(x for x in params.split(",") if x.strip())}
    c.ret = pname(ret[1:-1]) if ret else None
    text, decl = [], []
    if c.ret:
        decl.append(f"uint8_t *{cname(c.ret)} = ret;")
        c.callbuf[c.ret] = 1
    # statements
    body = re.sub(r"prototype_\d+\s*:\s*\.callprototype[^;]*;", "", body)
    body = re.sub(r"\.loc\s[^\n]*", "", body)
    text.append(begin_block())
    toks = re.split(r"(;|(?<=[\w$]):(?!:))", body)
    i, cur = 0, ""
    # walk: labels end in ':', statements in ';', scopes { } for calls
    buf = body
    p = 0
    callseq = 0
    while p < len(buf):
        m = re.compile(r"\s*").match(buf, p)
        p = m.end()
        if p >= len(buf):
            break
        if buf[p] == "{":
            callseq += 1
            text.append("{")
            p += 1
            c.scopes.append(dict(c.regs))
            continue
        if buf[p] == "}":
            text.append("}")
            p += 1
            c.regs = c.scopes.pop()
            continue
        m = re.compile(r"(\$?[\w$]+):").match(buf, p)
        if m:
            label = m[1]
            text.append(label.replace("$", "D") + ": ; " + begin_block())
            p = m.end()
            continue
        e = buf.index(";", p)
        s = buf[p:e].strip()
        p = e + 1
        if not s:
            continue
        if s.startswith(".reg"):
            m = re.match(r"\.reg\s+\.(\w+)\s+(.*)", s, re.S)
            ty = m[1]
            for r in m[2].split(","):
                r = r.strip()
                mm = re.fullmatch(r"(%?[\w$]+)<(\d+)>", r)
                if c.scopes:  # a register of an inner scope hides an outer one of its name
                    for rr in [f"{mm[1]}{k}" for k in range(int(mm[2]))] if mm else [r]:
                        c.regs[rr] = ty
                        text.append(f"{CT[ty]} {cname(rr)} = 0;")
                    continue
                for rr in [f"{mm[1]}{k}" for k in range(int(mm[2]))] if mm else [r]:
                    if rr in c.regs:
                        continue
                    c.regs[rr] = ty
                    if not mm:
                        decl.append(f"{CT[ty]} {cname(rr)} = 0;")
                if mm and int(mm[2]) > 1:
                    decl.append(
                        f"{CT[ty]} " + ", ".join(f"{cname(mm[1])}{k} = 0" for k in range(int(mm[2]))) + ";"
                    )
            continue
        if s.startswith(".local") or s.startswith(".shared"):
            if s.startswith(".shared"):
                err(s)
            m = re.search(r"([\w$]+)\[(\d+)\]", s)
            c.locals[m[1]] = 1
            decl.append(f"uint8_t {cname(m[1])}[{m[2]}] __attribute__((aligned(16)));")
            continue
        if s.startswith(".param"):
            m = re.search(r"\.b(\d+)\s+([\w$]+)(\[(\d+)\])?", s)
            n = int(m[4]) if m[4] else int(m[1]) // 8
            c.callbuf[m[2]] = 1
            text.append(f"uint8_t {cname(m[2])}[{max(n, 8)}] __attribute__((aligned(16)));")
            continue
        if s.startswith("."):
            if s.startswith(".pragma"):
                continue
            if s.startswith(".branchtargets"):  # of the label before, for brx.idx
                c.targets[label] = [each.strip().replace("$", "D") for each in s.split(None, 1)[1].split(",")]
                continue
            err("directive " + s)
        if re.match(r"(@!?%\w+\s+)?call", s):
            m = re.match(
                r"(@(!?)(%\w+)\s+)?call(?:\.uni)?\s*(?:\(\s*([\w$]+)\s*\)\s*,)?\s*(%?[\w$]+)\s*(?:,\s*\(([^)]*)\))?\s*(?:,\s*\w+)?$",
                s,
                re.S,
            )
            if not m:
                err(s)
            a = [cname(x.strip()) for x in (m[6] or "").split(",") if x.strip()]
            tgt = f"((FP){cname(m[5])})" if m[5].startswith("%") else f"F_{cname(m[5])}"
            cond = f"if ({m[2] or ''}{cname(m[3])}) " if m[1] else ""
            text.append(
                cond
                + "{ void *a_[] = {"
                + ", ".join([*a, "0"])
                + f"}}; {tgt}({cname(m[4]) if m[4] else '0'}, a_, w); }}"
            )
            continue
        text.append(instr(s, c))
        k = class_of(s)
        block_code[-1].append(s)
        if k:
            block_rows[-1][k] += 1
        if k == "meet" or re.match(r"@!?%\w+\s+bra", s):
            text.append(begin_block())
    P(f"static void F_{cname(name)}(void *ret, void **args, Where *w) {{")
    if getattr(c, "carry", False):
        decl.append("uint32_t cc_ = 0;")
    out.extend("  " + x for x in decl)
    out.extend("  " + x for x in text)
    P("}")
    if kind == "entry":
        P(f"void K_{cname(name)}(void **args, Where *w) {{ F_{cname(name)}(0, args, w); }}")
        P(f"int C_{cname(name)} = {int(any(MEETS.search(bodies.get(g, '')) for g in reach(name)))};")
P(f"int M_blocks = {n_blocks};")
rows = ", ".join("{" + ", ".join(str(r[k]) for k in CLASSES) + "}" for r in block_rows)
P(f"const uint16_t M_classes[][{len(CLASSES)}] = {{{rows}}};")
P(f"const uint16_t M_cycles[] = {{{', '.join(str(CYCLES[k]) for k in CLASSES)}}};")
P(
    f"const uint16_t M_overlapped[] = {{{', '.join(str(min(overlapped(code), 65535)) for code in block_code)}}};"
)
Path(sys.argv[2]).write_text("\n".join(out) + "\n")
