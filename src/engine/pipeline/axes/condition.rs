//! `where = "index < 5 and not stem ~ 'test*'"`: which items of an axis are kept.
//!
//! ```text
//! any  = all { "or" all }
//! all  = one { "and" one }
//! one  = "not" one | "(" any ")" | value op value
//! op   = "==" | "!=" | "<" | "<=" | ">" | ">=" | "~"      (~ compares with a pattern of * and ?)
//! value = field | number | 'text' | true | false
//! ```

use std::{cmp::Ordering, sync::Arc};

use crate::engine::pipeline::value::{Data, Value};

/// A condition that has been parsed.
#[derive(Debug, Clone, PartialEq)]
pub enum Condition {
    Any(Vec<Condition>),
    All(Vec<Condition>),
    Not(Box<Condition>),
    Compare { left: Operand, op: Op, right: Operand },
}

#[derive(Debug, Clone, PartialEq)]
pub enum Operand {
    Field(String),
    Number(f64),
    Text(String),
    Bool(bool),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Op {
    Equal,
    Unequal,
    Less,
    LessEqual,
    Greater,
    GreaterEqual,
    Like,
}

/// What a comparison sees of an operand.
#[derive(Debug, PartialEq)]
enum Seen {
    Number(f64),
    Text(Arc<str>),
    Bool(bool),
}

impl Condition {
    /// # Errors
    /// With what was expected where.
    pub fn parse(text: &str) -> Result<Self, String> {
        let tokens = tokens(text)?;
        let mut parser = Parser { tokens: &tokens, next: 0, depth: 0 };
        let res = parser.any()?;
        match parser.tokens.get(parser.next) {
            None => Ok(res),
            Some(token) => Err(format!("`{token}` is not expected behind a condition")),
        }
    }

    /// Whether it holds for an item with these fields.
    ///
    /// # Errors
    /// If there is no such field, or texts are compared with numbers.
    pub fn holds(&self, field: &dyn Fn(&str) -> Option<Value>) -> Result<bool, String> {
        match self {
            Self::Any(list) => {
                list.iter().try_fold(false, |holds, it| Ok(it.holds(field)? || holds))
            }
            Self::All(list) => {
                list.iter().try_fold(true, |holds, it| Ok(it.holds(field)? && holds))
            }
            Self::Not(inner) => Ok(!inner.holds(field)?),
            Self::Compare { left, op, right } => {
                compare(&see(left, field)?, *op, &see(right, field)?)
            }
        }
    }
}

fn see(operand: &Operand, field: &dyn Fn(&str) -> Option<Value>) -> Result<Seen, String> {
    let name = match operand {
        Operand::Number(it) => return Ok(Seen::Number(*it)),
        Operand::Text(it) => return Ok(Seen::Text(it.as_str().into())),
        Operand::Bool(it) => return Ok(Seen::Bool(*it)),
        Operand::Field(name) => name,
    };
    match field(name).map(|it| it.data) {
        Some(Data::Integer(it)) => Ok(Seen::Number(it as f64)),
        Some(Data::Float(it)) => Ok(Seen::Number(it)),
        Some(Data::Text(it)) => Ok(Seen::Text(it)),
        Some(Data::Bool(it)) => Ok(Seen::Bool(it)),
        Some(_) => Err(format!("`{name}` is not a single value")),
        None => Err(format!("the items have no field `{name}`")),
    }
}

fn compare(left: &Seen, op: Op, right: &Seen) -> Result<bool, String> {
    if op == Op::Like {
        return match (left, right) {
            (Seen::Text(text), Seen::Text(pattern)) => Ok(is_like(text, pattern)),
            _ => Err("`~` compares a text with a pattern".to_owned()),
        };
    }
    let order = match (left, right) {
        (Seen::Number(a), Seen::Number(b)) => a.total_cmp(b),
        (Seen::Text(a), Seen::Text(b)) => a.cmp(b),
        (Seen::Bool(a), Seen::Bool(b)) => a.cmp(b),
        _ => return Err(format!("{} cannot be compared with {}", left.name(), right.name())),
    };
    Ok(match op {
        Op::Equal => order == Ordering::Equal,
        Op::Unequal => order != Ordering::Equal,
        Op::Less => order == Ordering::Less,
        Op::LessEqual => order != Ordering::Greater,
        Op::Greater => order == Ordering::Greater,
        Op::GreaterEqual => order != Ordering::Less,
        Op::Like => unreachable!("patterns are compared above"),
    })
}

impl Seen {
    fn name(&self) -> String {
        match self {
            Self::Number(it) => format!("the number {it}"),
            Self::Text(it) => format!("the text '{it}'"),
            Self::Bool(it) => format!("`{it}`"),
        }
    }
}

/// Whether a text matches a pattern in which `*` stands for any letters and `?` for one.
pub fn is_like(text: &str, pattern: &str) -> bool {
    let (text, pattern): (Vec<char>, Vec<char>) =
        (text.chars().collect(), pattern.chars().collect());
    let (mut at, mut in_pattern) = (0, 0);
    // Where to go on if the letters behind the last `*` do not fit: one letter further in the text.
    let mut retry: Option<(usize, usize)> = None;
    while at < text.len() {
        match pattern.get(in_pattern) {
            Some('*') => {
                retry = Some((at, in_pattern));
                in_pattern += 1;
            }
            Some(&it) if it == '?' || it == text[at] => {
                at += 1;
                in_pattern += 1;
            }
            _ => match retry {
                Some((start, star)) => {
                    retry = Some((start + 1, star));
                    (at, in_pattern) = (start + 1, star + 1);
                }
                None => return false,
            },
        }
    }
    pattern[in_pattern..].iter().all(|&it| it == '*')
}

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Word(String),
    Text(String),
    Number(f64),
    Sign(&'static str),
}

impl std::fmt::Display for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Word(it) => f.write_str(it),
            Self::Text(it) => write!(f, "'{it}'"),
            Self::Number(it) => write!(f, "{it}"),
            Self::Sign(it) => f.write_str(it),
        }
    }
}

const SIGNS: [(&str, Option<Op>); 9] = [
    ("==", Some(Op::Equal)),
    ("!=", Some(Op::Unequal)),
    ("<=", Some(Op::LessEqual)),
    (">=", Some(Op::GreaterEqual)),
    ("<", Some(Op::Less)),
    (">", Some(Op::Greater)),
    ("~", Some(Op::Like)),
    ("(", None),
    (")", None),
];

fn tokens(text: &str) -> Result<Vec<Token>, String> {
    let mut res = Vec::new();
    let mut rest = text.trim_start();
    while let Some(first) = rest.chars().next() {
        let n_bytes = if let Some((sign, _)) = SIGNS.iter().find(|it| rest.starts_with(it.0)) {
            res.push(Token::Sign(sign));
            sign.len()
        } else if first == '\'' || first == '"' {
            let inner = &rest[1..];
            let end = inner.find(first).ok_or_else(|| format!("{first} is not closed"))?;
            res.push(Token::Text(inner[..end].to_owned()));
            end + 2
        } else {
            let is_part = |it: char| it.is_alphanumeric() || "_.-+".contains(it);
            let end = rest.find(|it| !is_part(it)).unwrap_or(rest.len());
            let word = &rest[..end];
            let starts_number = first.is_ascii_digit() || "-+.".contains(first);
            match word.parse::<f64>() {
                Ok(number) if starts_number => res.push(Token::Number(number)),
                _ if first.is_alphabetic() || first == '_' => {
                    res.push(Token::Word(word.to_owned()))
                }
                _ => return Err(format!("`{first}` is not expected in a condition")),
            }
            end
        };
        rest = rest[n_bytes..].trim_start();
    }
    Ok(res)
}

struct Parser<'a> {
    tokens: &'a [Token],
    next: usize,
    /// Of `not` and parentheses, bounded so that no text can exhaust the stack.
    depth: usize,
}

impl Parser<'_> {
    fn any(&mut self) -> Result<Condition, String> {
        let mut list = vec![self.all()?];
        while self.eat_word("or") {
            list.push(self.all()?);
        }
        Ok(if list.len() == 1 { list.remove(0) } else { Condition::Any(list) })
    }

    fn all(&mut self) -> Result<Condition, String> {
        let mut list = vec![self.one()?];
        while self.eat_word("and") {
            list.push(self.one()?);
        }
        Ok(if list.len() == 1 { list.remove(0) } else { Condition::All(list) })
    }

    fn one(&mut self) -> Result<Condition, String> {
        self.depth += 1;
        if self.depth > 100 {
            return Err("a condition cannot be nested more than 100 times".to_owned());
        }
        let res = if self.eat_word("not") {
            Condition::Not(Box::new(self.one()?))
        } else if self.eat_sign("(") {
            let inner = self.any()?;
            if !self.eat_sign(")") {
                return Err("`(` is not closed by `)`".to_owned());
            }
            inner
        } else {
            let left = self.operand()?;
            let op = self.op()?;
            Condition::Compare { left, op, right: self.operand()? }
        };
        self.depth -= 1;
        Ok(res)
    }

    fn operand(&mut self) -> Result<Operand, String> {
        let token = self.tokens.get(self.next).ok_or("a value is missing at the end")?;
        self.next += 1;
        Ok(match token {
            Token::Number(it) => Operand::Number(*it),
            Token::Text(it) => Operand::Text(it.clone()),
            Token::Word(it) if it == "true" || it == "false" => Operand::Bool(it == "true"),
            Token::Word(it) => Operand::Field(it.clone()),
            Token::Sign(it) => return Err(format!("a value is missing before `{it}`")),
        })
    }

    fn op(&mut self) -> Result<Op, String> {
        let expected = "expected one of `==`, `!=`, `<`, `<=`, `>`, `>=` and `~`";
        let token = self.tokens.get(self.next).ok_or_else(|| format!("{expected} at the end"))?;
        self.next += 1;
        let op = SIGNS.iter().find(|it| *token == Token::Sign(it.0)).and_then(|it| it.1);
        op.ok_or_else(|| format!("{expected}, but this is `{token}`"))
    }

    fn eat_word(&mut self, word: &str) -> bool {
        let found = matches!(self.tokens.get(self.next), Some(Token::Word(it)) if it == word);
        self.next += usize::from(found);
        found
    }

    fn eat_sign(&mut self, sign: &'static str) -> bool {
        let found = self.tokens.get(self.next) == Some(&Token::Sign(sign));
        self.next += usize::from(found);
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::graph::Place;

    /// `yes`, `no`, or the message, for the item `stem = "cat-03"`, `index = 3`.
    fn check(condition: &str, expected: &str) {
        let value = |data| Value::new(data, Place::new(0, 0..0));
        let (stem, index) = (value(Data::Text("cat-03".into())), value(Data::Integer(3)));
        let field = |name: &str| match name {
            "source.stem" | "stem" => Some(stem.clone()),
            "index" => Some(index.clone()),
            _ => None,
        };
        let found = match Condition::parse(condition).as_ref().map(|it| it.holds(&field)) {
            Ok(Ok(true)) => "yes".to_owned(),
            Ok(Ok(false)) => "no".to_owned(),
            Ok(Err(message)) => message,
            Err(message) => message.clone(),
        };
        assert_eq!(found, expected, "{condition}");
    }

    #[test]
    fn comparisons_hold_as_they_read() {
        check("index < 5", "yes");
        check("index>=3.5", "no");
        check("index != -3", "yes");
        check("stem == 'cat-03'", "yes");
        check("source.stem ~ \"cat*\"", "yes");
        check("stem ~ '*-?3' and not stem ~ 'dog*'", "yes");
        check("stem ~ 'cat'", "no");
        check("index == 1 or index == 2 or (index == 3 and true == true)", "yes");
        check("not (index == 3 or index == 4)", "no");
    }

    #[test]
    fn what_makes_no_sense_is_said() {
        check("index <", "a value is missing at the end");
        check("index", "expected one of `==`, `!=`, `<`, `<=`, `>`, `>=` and `~` at the end");
        check("index = 3", "`=` is not expected in a condition");
        check("(index == 3", "`(` is not closed by `)`");
        check("index == 3 stem", "`stem` is not expected behind a condition");
        check("size == 3", "the items have no field `size`");
        check("stem < 3", "the text 'cat-03' cannot be compared with the number 3");
        check("stem == 'cat", "' is not closed");
        check("", "a value is missing at the end");
        check(&"not ".repeat(1000), "a condition cannot be nested more than 100 times");
    }

    #[test]
    fn patterns_match_whole_texts() {
        for (text, pattern, expected) in [
            ("", "*", true),
            ("abcabd", "*ab?", true),
            ("abcabd", "ab", false),
            ("aaa", "a*a*a*a", false),
            ("größe", "gr??e", true),
        ] {
            assert_eq!(is_like(text, pattern), expected, "{text} {pattern}");
        }
    }
}
